"""SAM2's video predictor, with the same results with and without SAM2's compiled extension."""

from typing import Any

from sam2.sam2_video_predictor import SAM2VideoPredictor
from torch import Tensor

from egosplat.models.mask_holes import fill_holes


class VideoPredictor(SAM2VideoPredictor):
    """``SAM2VideoPredictor`` that fills holes by ``mask_holes.fill_holes``."""

    def __init__(self, fill_hole_area: int, **arguments: Any) -> None:
        super().__init__(fill_hole_area=0, **arguments)
        self.hole_area = fill_hole_area

    def _run_single_frame_inference(self, *arguments: Any, **named: Any) -> tuple[dict[str, Any], Tensor]:
        output, masks = super()._run_single_frame_inference(*arguments, **named)
        masks = fill_holes(masks, self.hole_area)
        return output | {"pred_masks": masks.to(output["pred_masks"].device)}, masks
