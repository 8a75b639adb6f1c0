"""Draw tubes, rectangles and their shadows into an image of linear light, anti-aliased, in dirty tiles only.

Images are (H, W, C) float32, tiles (H / TILE, W / TILE) uint8. An edge is blurred by the lens: its coverage is the
Gaussian distribution function of the distance.
"""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
FloatImage = npt.NDArray[np.float32]
IntImage = npt.NDArray[np.int32]
IntArray = npt.NDArray[np.int32]
Tiles = npt.NDArray[np.uint8]

TILE = 16
REACH = 2.6  # in standard deviations: nothing is drawn beyond
# Segments are rounded off where they meet, by no more than this: an end stays flat.
_JOINT_PX = 1.5


@numba.njit(cache=True, nogil=True)
def step_of(x: float) -> float:
    """The Gaussian distribution function, near enough."""
    if x > 4.0:
        return 1.0
    if x < -4.0:
        return 0.0
    return float(1.0 / (1.0 + np.exp(-x * (1.5958 + 0.07057 * x * x))))


@numba.njit(cache=True, nogil=True)
def _hash01(i: int, j: int, seed: int) -> float:
    h = (i * 374761393 + j * 668265263 + seed * 2147483647) & 0x7FFFFFFF
    h = ((h ^ (h >> 13)) * 1274126177) & 0x7FFFFFFF
    return ((h ^ (h >> 16)) & 0xFFFF) / 65535.0


@numba.njit(cache=True, nogil=True)
def _grain(u: float, v: float, seed: int) -> float:
    i, j = int(np.floor(u)), int(np.floor(v))
    a, b = u - i, v - j
    top = _hash01(i, j, seed) * (1.0 - a) + _hash01(i + 1, j, seed) * a
    low = _hash01(i, j + 1, seed) * (1.0 - a) + _hash01(i + 1, j + 1, seed) * a
    return float(2.0 * (top * (1.0 - b) + low * b) - 1.0)


@numba.njit(cache=True, nogil=True)
def restore_tiles(image: FloatImage, background: FloatImage, tiles: Tiles) -> None:
    """Copy the background into the dirty tiles."""
    for ty in range(tiles.shape[0]):
        for tx in range(tiles.shape[1]):
            if tiles[ty, tx]:
                y0, x0 = ty * TILE, tx * TILE
                y1, x1 = min(y0 + TILE, image.shape[0]), min(x0 + TILE, image.shape[1])
                image[y0:y1, x0:x1] = background[y0:y1, x0:x1]


@numba.njit(cache=True, nogil=True)
def mark_points(tiles: Tiles, points: FloatArray, reach: FloatArray) -> None:
    """Mark the tiles within ``reach`` (N,) px of the points (N, 2)."""
    for i in range(points.shape[0]):
        x0 = max(int((points[i, 0] - reach[i]) // TILE), 0)
        x1 = min(int((points[i, 0] + reach[i]) // TILE), tiles.shape[1] - 1)
        y0 = max(int((points[i, 1] - reach[i]) // TILE), 0)
        y1 = min(int((points[i, 1] + reach[i]) // TILE), tiles.shape[0] - 1)
        for ty in range(y0, y1 + 1):
            for tx in range(x0, x1 + 1):
                tiles[ty, tx] = 1


@numba.njit(cache=True, nogil=True)
def mark_box(tiles: Tiles, box: FloatArray, reach: float) -> None:
    """Mark the tiles within ``reach`` px of a rectangle (cx, cy, angle, half length, half width)."""
    c, s = np.cos(box[2]), np.sin(box[2])
    grown = reach + 0.75 * TILE
    for ty in range(tiles.shape[0]):
        for tx in range(tiles.shape[1]):
            dx, dy = (tx + 0.5) * TILE - box[0], (ty + 0.5) * TILE - box[1]
            if abs(c * dx + s * dy) < box[3] + grown and abs(-s * dx + c * dy) < box[4] + grown:
                tiles[ty, tx] = 1


@numba.njit(cache=True, nogil=True)
def nearest_on_tube(
    tiles: Tiles,
    points: FloatArray,
    radii: FloatArray,
    heights: FloatArray,
    arcs: FloatArray,
    margin: float,
    hit: IntImage,
    place: FloatImage,
    across: FloatImage,
    beyond: FloatImage,
    touched: IntArray,
) -> int:
    """For every pixel within ``margin`` px of the tube in dirty tiles the segment that it belongs to.

    points (N, 2) px, radii (N,) px, heights (N,), arcs (N,) mm. Writes per pixel: hit segment + 1, place along it 0..1,
    signed distance across, distance beyond a flat end. Of two passes over a pixel the higher wins where they are far
    apart along the tube. Returns the number of pixels in ``touched``.
    """
    count = 0
    height_px, width_px = hit.shape
    last = points.shape[0] - 2
    for k in range(points.shape[0] - 1):
        ax, ay, bx, by = points[k, 0], points[k, 1], points[k + 1, 0], points[k + 1, 1]
        dx, dy = bx - ax, by - ay
        length = np.sqrt(dx * dx + dy * dy)
        if length < 1e-9:
            continue
        ux, uy = dx / length, dy / length
        reach = max(radii[k], radii[k + 1]) + margin
        y0, y1 = max(int(min(ay, by) - reach), 0), min(int(max(ay, by) + reach) + 1, height_px - 1)
        x0, x1 = max(int(min(ax, bx) - reach), 0), min(int(max(ax, bx) + reach) + 1, width_px - 1)
        for y in range(y0, y1 + 1):
            for x in range(x0, x1 + 1):
                if not tiles[y // TILE, x // TILE]:
                    continue
                rx, ry = x - ax, y - ay
                along = rx * ux + ry * uy
                side = -rx * uy + ry * ux
                over = 0.0
                far = abs(side)
                if along < 0.0:
                    if k == 0:
                        over = -along
                    elif along < -_JOINT_PX:
                        continue
                    else:
                        far = np.sqrt(along * along + side * side)
                    along = 0.0
                elif along > length:
                    if k == last:
                        over = along - length
                    elif along > length + _JOINT_PX:
                        continue
                    else:
                        far = np.sqrt((along - length) ** 2 + side * side)
                    along = length
                if far > reach or over > margin:
                    continue
                far = far if side >= 0.0 else -far
                if hit[y, x] == 0:
                    touched[count] = y * width_px + x
                    count += 1
                else:
                    other = hit[y, x] - 1
                    apart = abs(arcs[k] - arcs[other]) > 25.0
                    if apart and abs(far) < radii[k] and abs(across[y, x]) < radii[other]:
                        better = heights[k] > heights[other]
                    else:
                        better = abs(far) + over < abs(across[y, x]) + beyond[y, x]
                    if not better:
                        continue
                hit[y, x] = k + 1
                place[y, x] = along / length
                across[y, x] = far
                beyond[y, x] = over
    return count


@numba.njit(cache=True, nogil=True)
def shade_tube(
    image: FloatImage,
    light_map: FloatImage,
    points: FloatArray,
    normals: FloatArray,
    radii: FloatArray,
    arcs: FloatArray,
    rgb: FloatArray,
    look: FloatArray,
    light: FloatArray,
    half: FloatArray,
    sigma: float,
    hit: IntImage,
    place: FloatImage,
    across: FloatImage,
    beyond: FloatImage,
    touched: IntArray,
    count: int,
) -> None:
    """Mix the tube's colour into the touched pixels, and clear the hits.

    look: diameter mm, specular strength, exponent, ambient, grain, grain size mm, print amplitude, period mm, length
    mm, clear share, seed. light, half: unit vectors to the light, and half-way to the camera.
    """
    width_px = hit.shape[1]
    seed = int(look[10])
    for i in range(count):
        y, x = touched[i] // width_px, touched[i] % width_px
        k = hit[y, x] - 1
        t = place[y, x]
        hit[y, x] = 0
        radius = radii[k] + t * (radii[k + 1] - radii[k])
        d = across[y, x]
        cover = step_of((radius - d) / sigma) - step_of((-radius - d) / sigma)
        if k == 0 or k == points.shape[0] - 2:
            end = (1.0 - t) if k != 0 else t
            if beyond[y, x] > 0.0:
                cover *= step_of(-beyond[y, x] / sigma)
            elif end < 1.0:
                dx, dy = points[k + 1, 0] - points[k, 0], points[k + 1, 1] - points[k, 1]
                cover *= step_of(end * np.sqrt(dx * dx + dy * dy) / sigma)
        if cover < 0.002:
            continue
        c = min(max(d / radius, -0.97), 0.97)
        up = np.sqrt(1.0 - c * c)
        nx = c * (normals[k, 0] + t * (normals[k + 1, 0] - normals[k, 0]))
        ny = c * (normals[k, 1] + t * (normals[k + 1, 1] - normals[k, 1]))
        lambert = max(0.0, nx * light[0] + ny * light[1] + up * light[2])
        glint = max(0.0, nx * half[0] + ny * half[1] + up * half[2])
        arc = arcs[k] + t * (arcs[k + 1] - arcs[k])
        angle = np.arcsin(c)
        bright = 1.0
        if look[4] > 0.0:
            bright += look[4] * _grain(arc / look[5], angle * 0.5 * look[0] / look[5] + 512.0, seed)
        if look[6] != 0.0 and abs(angle) < 0.55:
            within = arc % look[7]
            cell = arc / 1.1
            if within < look[8] and _hash01(int(cell), int(arc / look[7]), seed + 7) > 0.4:
                # Bars of equal width with soft edges stand for letters.
                edge = min(cell - np.floor(cell), np.floor(cell) + 1.0 - cell)
                bright *= 1.0 + look[6] * min(1.0, 4.0 * edge + 0.4)
        diffuse = bright * (look[3] + (1.0 - look[3]) * lambert)
        shine = look[1] * glint ** look[2]
        keep = 1.0 - cover * (1.0 - look[9])
        for channel in range(image.shape[2]):
            lit = light_map[y, x] * (rgb[channel] * diffuse + shine)
            image[y, x, channel] = image[y, x, channel] * keep + cover * (1.0 - look[9]) * lit


@numba.njit(cache=True, nogil=True)
def shadow_tube(
    image: FloatImage,
    radii: FloatArray,
    sigma_px: FloatArray,
    strength: float,
    hit: IntImage,
    place: FloatImage,
    across: FloatImage,
    beyond: FloatImage,
    touched: IntArray,
    count: int,
) -> None:
    """Darken the touched pixels by the soft shadow of a tube, and clear the hits. sigma_px (N,): penumbra per node."""
    width_px = hit.shape[1]
    for i in range(count):
        y, x = touched[i] // width_px, touched[i] % width_px
        k = hit[y, x] - 1
        t = place[y, x]
        hit[y, x] = 0
        soft = sigma_px[k] + t * (sigma_px[k + 1] - sigma_px[k])
        radius = radii[k]
        cover = step_of((radius - across[y, x]) / soft) - step_of((-radius - across[y, x]) / soft)
        if beyond[y, x] > 0.0:
            cover *= 2.0 * step_of(-beyond[y, x] / soft)
        for channel in range(image.shape[2]):
            image[y, x, channel] *= 1.0 - strength * cover


@numba.njit(cache=True, nogil=True)
def draw_box(
    image: FloatImage,
    light_map: FloatImage,
    tiles: Tiles,
    box: FloatArray,
    texture: FloatImage,
    tint: FloatArray,
    sigma: float,
    strength: float,
) -> None:
    """Draw a textured rectangle (cx, cy, angle, half length, half width, texel scale), or its shadow (strength > 0)."""
    c, s = np.cos(box[2]), np.sin(box[2])
    margin = REACH * sigma
    reach_x = abs(c) * (box[3] + margin) + abs(s) * (box[4] + margin)
    reach_y = abs(s) * (box[3] + margin) + abs(c) * (box[4] + margin)
    y0, y1 = max(int(box[1] - reach_y), 0), min(int(box[1] + reach_y) + 1, image.shape[0] - 1)
    x0, x1 = max(int(box[0] - reach_x), 0), min(int(box[0] + reach_x) + 1, image.shape[1] - 1)
    th, tw = texture.shape
    for y in range(y0, y1 + 1):
        for x in range(x0, x1 + 1):
            if not tiles[y // TILE, x // TILE]:
                continue
            dx, dy = x - box[0], y - box[1]
            u, v = c * dx + s * dy, -s * dx + c * dy
            if abs(u) > box[3] + margin or abs(v) > box[4] + margin:
                continue
            cover = (step_of((box[3] - u) / sigma) - step_of((-box[3] - u) / sigma)) * (
                step_of((box[4] - v) / sigma) - step_of((-box[4] - v) / sigma)
            )
            if strength > 0.0:
                for channel in range(image.shape[2]):
                    image[y, x, channel] *= 1.0 - strength * cover
                continue
            fu = min(max((u / box[3] + 1.0) * 0.5 * (tw - 1), 0.0), tw - 1.001)
            fv = min(max((v / box[4] + 1.0) * 0.5 * (th - 1), 0.0), th - 1.001)
            iu, iv = int(fu), int(fv)
            a, b = fu - iu, fv - iv
            grey = (1.0 - b) * ((1.0 - a) * texture[iv, iu] + a * texture[iv, iu + 1]) + b * (
                (1.0 - a) * texture[iv + 1, iu] + a * texture[iv + 1, iu + 1]
            )
            lit = cover * light_map[y, x] * grey
            for channel in range(image.shape[2]):
                image[y, x, channel] = image[y, x, channel] * (1.0 - cover) + lit * tint[channel]


@numba.njit(cache=True, nogil=True)
def draw_belt(
    image: FloatImage,
    light_map: FloatImage,
    tiles: Tiles,
    across: FloatImage,
    along: FloatImage,
    inside: FloatImage,
    texture: FloatImage,
    shift: float,
    texels_per_mm: float,
) -> None:
    """Draw the belt into the dirty tiles, shifted by ``shift`` mm.

    across, along (H, W): places on the belt, mm; inside (H, W): coverage; texture repeats along.
    """
    th, tw = texture.shape
    for ty in range(tiles.shape[0]):
        for tx in range(tiles.shape[1]):
            if not tiles[ty, tx]:
                continue
            for y in range(ty * TILE, min((ty + 1) * TILE, image.shape[0])):
                for x in range(tx * TILE, min((tx + 1) * TILE, image.shape[1])):
                    if inside[y, x] < 0.002:
                        continue
                    fu = ((along[y, x] - shift) * texels_per_mm) % tw
                    fv = min(max(across[y, x] * texels_per_mm, 0.0), th - 1.001)
                    iu, iv = int(fu) % tw, int(fv)
                    ju = (iu + 1) % tw
                    a, b = fu - int(fu), fv - iv
                    grey = (1.0 - b) * ((1.0 - a) * texture[iv, iu] + a * texture[iv, ju]) + b * (
                        (1.0 - a) * texture[iv + 1, iu] + a * texture[iv + 1, ju]
                    )
                    for channel in range(image.shape[2]):
                        mix = inside[y, x]
                        image[y, x, channel] = image[y, x, channel] * (1.0 - mix) + mix * light_map[y, x] * grey
