"""SAM2's video predictor, the same on machines with and without its compiled extension."""

from typing import Any

from sam2.sam2_video_predictor import SAM2VideoPredictor
from torch import Tensor

from egosplat.models.mask_holes import fill_holes


class VideoPredictor(SAM2VideoPredictor):
    """``SAM2VideoPredictor`` whose holes are filled by ``holes.fill_holes``; the rest is SAM2's own."""

    def __init__(self, fill_hole_area: int, **arguments: Any) -> None:
        super().__init__(fill_hole_area=0, **arguments)
        self.hole_area = fill_hole_area

    def _run_single_frame_inference(self, *arguments: Any, **named: Any) -> tuple[dict[str, Any], Tensor]:
        output, masks = super()._run_single_frame_inference(*arguments, **named)
        masks = fill_holes(masks, self.hole_area)
        return output | {"pred_masks": masks.to(output["pred_masks"].device)}, masks
