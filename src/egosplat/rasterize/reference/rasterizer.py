"""The rasterizer in plain PyTorch: the definition that the other backends are tested against."""

from dataclasses import fields, replace

import torch
from torch import Tensor

from egosplat.rasterize.contract import (
    ALPHA_THRESHOLD,
    MAX_ALPHA,
    MIN_DEPTH_ALPHA,
    MIN_TRANSMITTANCE,
    Arguments,
    Render,
    camera_centers,
    usable_gaussians,
)
from egosplat.rasterize.reference.projection import Projected, project
from egosplat.rasterize.reference.spherical_harmonics import spherical_harmonics


def rasterization(arguments: Arguments) -> Render:
    """``api.rasterization`` with autograd, in float32 or float64, on any device."""
    a = arguments
    values = [value for value in (a.means, a.scales, a.opacities, a.colors, a.features) if value is not None]
    # ``project`` culls a Gaussian of opacity 0, whatever its other numbers are.
    usable = replace(a, opacities=torch.where(usable_gaussians(a.quats, *values), a.opacities, 0.0))
    projections = [project(usable, camera) for camera in range(len(a.viewmats))]
    names = [field.name for field in fields(Projected)]
    meta = {name: torch.stack([getattr(each, name) for each in projections]) for name in names}
    # Parts of ``meta``, so that its tensors get the gradients.
    seen = [Projected(*parts) for parts in zip(*meta.values(), strict=True)]
    colors = [a.colors] * len(seen)
    if a.sh_degree is not None and a.shows_colors:
        cameras = zip(camera_centers(a.viewmats), meta["radii"], strict=True)
        colors = [view_colors(a.means, a.colors, center, a.sh_degree, radii) for center, radii in cameras]
    channels = [_stack_channels(a, own, one.depths) for own, one in zip(colors, seen, strict=True)]
    images = [composite(*each, a.width, a.height) for each in zip(seen, channels, strict=True)]
    composited, alpha = (torch.stack(parts) for parts in zip(*images, strict=True))
    meta |= {"width": a.width, "height": a.height, "n_cameras": len(a.viewmats)}
    return _finish(a, composited, alpha), alpha, meta


def view_colors(means: Tensor, coeffs: Tensor, center: Tensor, sh_degree: int, radii: Tensor) -> Tensor:
    """(N, 3) colors of the visible Gaussians from a camera center: ``max(SH + 0.5, 0)``; 0 for the others.

    Args:
        means, coeffs, center: (N, 3) [m], (N, K, 3), and (3,) in the world [m].
        radii: (N, 2), 0 where culled.
    """
    rows = (radii > 0).all(dim=-1).nonzero().squeeze(-1)
    dirs = means.index_select(0, rows) - center
    colors = (spherical_harmonics(sh_degree, dirs, coeffs.index_select(0, rows)) + 0.5).clamp(min=0.0)
    return colors.new_zeros(len(means), 3).index_copy(0, rows, colors)


def _stack_channels(a: Arguments, colors: Tensor, depths: Tensor) -> Tensor:
    """Stack the (N, X) channels that the mode composites: colors (N, D), features (N, F) if any, depths (N,)."""
    parts = []
    if a.shows_colors:
        parts.append(colors)
        parts += [] if a.features is None else [a.features]
    if a.shows_depth:
        parts.append(depths[..., None])
    return torch.cat(parts, dim=-1)


def _finish(a: Arguments, composited: Tensor, alpha: Tensor) -> Tensor:
    """Blend (C, H, W, X) channels with the backgrounds, (C, D + F); convert accumulated to expected depth if needed."""
    depth_channels = int(a.shows_depth)
    colors, depth = composited.split([composited.shape[-1] - depth_channels, depth_channels], dim=-1)
    if a.backgrounds is not None and a.shows_colors:
        colors = colors + (1.0 - alpha) * a.backgrounds[:, None, None, :]
    if a.shows_expected_depth:
        depth = depth / alpha.clamp(min=MIN_DEPTH_ALPHA)
    return torch.cat([colors, depth], dim=-1)


# Side of a tile [px].
TILE = 16


def composite(seen: Projected, channels: Tensor, width: int, height: int) -> tuple[Tensor, Tensor]:
    """Composite the (N, X) channels of Gaussians in one image, nearest first, without a background.

    Equal depths keep the order of the Gaussians; pixel centers lie at integer + 0.5. Gradients reach the centers, conics,
    opacities and channels.

    Returns:
        (H, W, X) weighted sums and (H, W, 1) accumulated alpha.
    """
    columns, rows = -(-width // TILE), -(-height // TILE)
    ids, counts = intersect_tiles(seen, columns, rows)
    # A channel of ones accumulates alpha. One gather for all tiles makes the gradient one scatter.
    opacities = seen.opacities[:, None]
    table = torch.cat([seen.means2d, seen.conics, opacities, channels, torch.ones_like(opacities)], dim=-1)
    tiles = table.index_select(0, ids).split(counts.tolist())
    pixels = torch.stack(
        [_composite_tile(tile, index % columns, index // columns) for index, tile in enumerate(tiles)]
    )
    image = pixels.unflatten(0, (rows, columns)).transpose(1, 2).reshape(rows * TILE, columns * TILE, -1)
    image = image[:height, :width]
    return image[..., :-1], image[..., -1:]


def intersect_tiles(seen: Projected, columns: int, rows: int) -> tuple[Tensor, Tensor]:
    """Find the Gaussians that reach each of ``columns`` x ``rows`` tiles, by their bounding rectangles.

    Returns:
        (I,) int64 indices of Gaussians, tile after tile (row-major) and nearest first within each;
        (rows * columns,) int64 number of Gaussians in each tile.
    """
    with torch.no_grad():
        visible = (seen.radii > 0).all(dim=-1).nonzero().squeeze(-1)
        order = visible[seen.depths[visible].argsort(stable=True)]
        grid = seen.means2d.new_tensor([columns, rows])
        centers, extents = seen.means2d[order], seen.radii[order].to(seen.means2d.dtype)
        # Clamp before the conversion to integers, which a huge extent would overflow.
        first = ((centers - extents) / TILE).floor().clamp(min=0.0).minimum(grid).long()
        last = ((centers + extents) / TILE).ceil().clamp(min=0.0).minimum(grid).long()
        spans = (last - first).clamp(min=0)
        areas = spans.prod(dim=-1)
        owner = torch.arange(len(order), device=areas.device).repeat_interleave(areas)
        # Number of each (Gaussian, tile) pair within its Gaussian's rectangle, counted row by row.
        within = torch.arange(len(owner), device=areas.device) - (areas.cumsum(0) - areas)[owner]
        across = spans[owner, 0]
        tile_x = first[owner, 0] + within % across
        tile_y = first[owner, 1] + within.div(across, rounding_mode="floor")
        tile = tile_y * columns + tile_x
        by_tile = tile.argsort(stable=True)
        return order[owner[by_tile]], torch.bincount(tile, minlength=rows * columns)


def _composite_tile(table: Tensor, column: int, row: int) -> Tensor:
    """(L, 6 + X) mean, conic, opacity and channels, nearest first -> (TILE, TILE, X) composited channels."""
    mean_x, mean_y, conic_xx, conic_xy, conic_yy, opacity = table[:, :6].T.unbind()
    centers = torch.arange(TILE, dtype=table.dtype, device=table.device) + 0.5
    dx, dy = (centers + column * TILE)[:, None] - mean_x, (centers + row * TILE)[:, None] - mean_y
    # sigma[y, x, Gaussian]; the parentheses keep most products smaller than that.
    sigma = (conic_xy * dy)[:, None] * dx + (0.5 * conic_xx * dx * dx) + (0.5 * conic_yy * dy * dy)[:, None]
    alpha = (opacity * torch.exp(-sigma)).clamp(max=MAX_ALPHA)
    alpha = torch.where((sigma >= 0) & (alpha >= ALPHA_THRESHOLD), alpha, 0.0)
    transmittance = (1.0 - alpha).cumprod(dim=-1)
    before = torch.cat([alpha.new_ones(TILE, TILE, 1), transmittance], dim=-1)[..., :-1]
    # The running product never rises, so this stays false after the Gaussian that ends the pixel.
    weights = alpha * before * (transmittance > MIN_TRANSMITTANCE)
    return weights @ table[:, 6:]
