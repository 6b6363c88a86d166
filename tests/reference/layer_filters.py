"""Surround erase, cone erase, plane fill, nearest fill and push and pull, in plain loops."""

from __future__ import annotations

import math

import numpy as np

from .layers import (
    FARTHEST_RING,
    Grid,
    Spacing,
    companions,
    f32,
    present,
    pyramid_of,
    sector,
    spacing_of,
    square_round,
    surrounded,
)

FILLED, ERASED, FILLED_BORDER = 2, 3, 4
Maps = tuple[np.ndarray, np.ndarray, np.ndarray]


def erased(maps: Maps, hidden: np.ndarray, keep_depth: bool) -> Maps:
    """The maps with some pixels erased."""
    depth, index, state = (array.copy() for array in maps)
    state[hidden] = ERASED
    if not keep_depth:
        depth[hidden], index[hidden] = 0, -1
    return depth, index, state


def surround_erase(maps: Maps, grid: Grid, keep_depth: bool = False) -> Maps:
    """A pixel goes if it is seen too little freely between the nearer ones round it, its companions
    as well: by the mean of its own freedom and theirs. Strays go too.
    """
    depth, _, state = maps
    there = present(depth, state)
    spacing = spacing_of(depth, state, grid)
    freedom = freedom_of(maps, grid)
    hidden = np.zeros(depth.shape, bool)
    for row, column in np.argwhere(there):
        reach = min(spacing.own[row, column], FARTHEST_RING)
        own = int(freedom[row, column])
        four = [own] * 4
        for k, (_, right, down) in enumerate(companions(depth, there, grid, row, column, reach)):
            four[k] = int(freedom[row + down, (column + right) % depth.shape[1]])
        hidden[row, column] = (4 * own + sum(four)) // 8 < 198
    return erased(maps, hidden | strays_of(maps, grid, hidden), keep_depth)


def strays_of(maps: Maps, grid: Grid, hidden: np.ndarray) -> np.ndarray:
    """Pixels with 12 others that are not hidden in nearer rings than their nearest companion; but
    none that is hidden, of a line, or without four companions.
    """
    depth, _, state = maps
    there = present(depth, state)
    spacing = spacing_of(depth, state, grid)
    strays = np.zeros(depth.shape, bool)
    for row, column in np.argwhere(there & ~hidden & ~spacing.line):
        four = companions(depth, there, grid, row, column)
        if len(four) == 4:
            nearer = square_round(there & ~hidden, grid, row, column, four[0][0] - 1)
            strays[row, column] = len(list(nearer)) >= 12
    return strays


def freedom_of(maps: Maps, grid: Grid) -> np.ndarray:
    """How freely every pixel is seen between nearer ones, in eighths, up to 27."""
    depth, _, state = maps
    spacing = spacing_of(depth, state, grid)
    levels = pyramid_of(depth, spacing)
    freedom = np.zeros(depth.shape, int)
    for row, column in np.argwhere(present(depth, state)):
        sectors: set[int] = set()
        ways = np.full(8, f32(1e6))
        for x, y, way in _hiding(depth, spacing, levels, grid, row, column):
            k = sector(x, y)
            sectors.add(k)
            ways[k // 4] = min(ways[k // 4], way)
        run = next((n for n in range(32) if surrounded(sectors, n)), 32)
        gap = min(ways[k] + ways[(k + apart) % 8] for k in range(8) for apart in (3, 4))
        free = f32(run) + f32(8) * gap + (f32(6) if spacing.line[row, column] else f32(0))
        freedom[row, column] = int(f32(8) * min(free, f32(27))) if run <= 14 else 8 * 27
    return freedom


def _hiding(depth, spacing, levels, grid, row, column):
    """What hides towards a pixel: (right, down, distance in its extents)."""
    own, own_spacing = depth[row, column], spacing.own[row, column]
    margin = f32(0.02) + f32(0.004) * own
    for level, cells in enumerate(levels):
        for r in range((row >> level) - 1, (row >> level) + 2):
            for c in range((column >> level) - 1, (column >> level) + 2):
                side = grid.column(c, len(cells[0]))
                if not 0 <= r < len(cells) or side < 0 or cells[r][side] is None:
                    continue
                near, q_row, q_column = cells[r][side]
                s, extent = spacing.own[q_row, q_column], spacing.extent[q_row, q_column]
                y, x = q_row - row, grid.offset(q_column - column, depth.shape[1])
                square = f32(x * x + y * y)
                if square > (f32(2) if s == 1 else f32(9) * extent * extent):
                    continue
                ahead, way = own - near - margin, np.sqrt(square)
                is_ahead = ahead > 0 and ahead > f32(0.5) * way * grid.pitch(near)
                if is_ahead and s <= max(6 * own_spacing, 12) and (s > 1 or own_spacing > 1):
                    yield x, y, way if s == 1 else (way - f32(0.5)) / extent


def cone_erase(maps: Maps, grid: Grid, radius: int, angle: float) -> Maps:
    """A pixel goes if less solid angle is free before it than that of a cone."""
    depth, _, state = maps
    rows, columns = depth.shape
    there = present(depth, state)
    hidden = np.zeros(depth.shape, bool)
    least = f32(1 - math.cos(math.radians(angle)))
    for row, column in np.argwhere(there):
        own = depth[row, column]
        highest = np.zeros(8, f32)
        for y in range(-radius, radius + 1):
            for x in range(-radius, radius + 1):
                c = grid.column(column + x, columns)
                if not 0 <= row + y < rows or c < 0 or x * x + y * y > radius * radius:
                    continue
                ahead = own - depth[row + y, c]
                if there[row + y, c] and ahead > f32(0.02):
                    aside = np.sqrt(f32(x * x + y * y)) * grid.pitch(depth[row + y, c])
                    cosine = ahead / np.sqrt(ahead * ahead + aside * aside)
                    k = sector(x, y) // 4
                    highest[k] = max(highest[k], cosine)
        free = f32(0)
        for value in highest:
            free = free + f32(0.125) * (f32(1) - value)
        hidden[row, column] = free < least
    return erased(maps, hidden, keep_depth=False)


def plane_fill(maps: Maps, grid: Grid) -> Maps:
    """Blocks of 4 x 4 take the plane of the one layer round them; of others each 2 x 2 the plane of
    the nearest of three layers that surrounds its middle, or of the closest sample's layer.
    """
    depth, index, state = maps
    out = tuple(array.copy() for array in maps)
    rows, columns = depth.shape
    there = present(depth, state)
    spacing = spacing_of(depth, state, grid).own
    same = np.zeros(depth.shape, f32)
    levels = pyramid_of(depth, Spacing(spacing, same, same))

    def fill(top, left, size, layer, kind=FILLED):
        ((a, b, c), near, far), (_, x, y, _) = layer
        middle = (size - 1) / 2
        source = index[top + int(y + middle), (left + int(x + middle)) % columns]
        for row in range(top, min(top + size, rows)):
            for column in range(left, min(left + size, columns)):
                if there[row, column]:
                    continue
                q = a + b * f32(column - left - middle) + c * f32(row - top - middle)
                q = min(max(q, f32(1) / far), f32(1) / near)
                z = min(max(f32(1) / q, near), far)
                for array, value in zip(out, (z, source, kind), strict=True):
                    array[row, column] = value

    for top in range(0, rows, 4):
        for left in range(0, columns, 4):
            samples = _samples(levels, spacing, grid, top, left, 4)
            if not samples:
                continue
            one = _layer_from(samples, f32(0), grid)
            if one is not None and len(one[2]) == len(samples) and _surrounds(one[2]):
                (plane, near, far), closest = _filled(*one)
                fill(top, left, 4, ((plane, *_thickened(near, far)), closest))
                continue
            for part_top in range(top, min(top + 4, rows), 2):
                for part_left in range(left, min(left + 4, columns), 2):
                    samples = _samples(levels, spacing, grid, part_top, part_left, 2)
                    layer, kind = _layer(samples, grid)
                    if layer is not None:
                        fill(part_top, part_left, 2, layer, kind)
    return out


def _samples(levels, spacing, grid, top, left, size):
    """(depth, x, y from the block's middle [px], (distance, S)) of what reaches it, in order."""
    samples, seen = [], set()
    columns = spacing.shape[1]
    more = f32(1.5) if size == 4 else f32(0)  # what reaches a quarter of it
    for level, cells in enumerate(levels):
        below = max(size >> level, 1)
        for r in range((top >> level) - 1, (top >> level) + below + 1):
            for c in range((left >> level) - 1, (left >> level) + below + 1):
                side = c if 0 <= c < len(cells[0]) else -1
                if len(cells[0]) > below + 1:  # narrower: no area twice
                    side = grid.column(c, len(cells[0]))
                if not 0 <= r < len(cells) or side < 0 or cells[r][side] is None:
                    continue
                near, row, column = cells[r][side]
                middle = (size - 1) / 2
                x, y = grid.offset(column - left, columns) - middle, row - top - middle
                way = f32(0.5) * np.sqrt(f32(4 * (x * x + y * y)))
                reach = f32(1.5) * f32(spacing[row, column]) + more
                if way <= reach and (row, column) not in seen:
                    seen.add((row, column))
                    samples.append((near, x, y, (way, spacing[row, column])))
        if len(samples) >= 4:
            break
    return samples


def _layer_from(samples, beyond, grid):
    """The first layer beyond a depth: its nearest and farthest depth, its samples in order, and the
    place of the nearest among them; None without one."""
    left = [sample for sample in samples if sample[0] > beyond]
    if not left:
        return None
    near, x0, y0, _ = first = min(left, key=lambda sample: sample[0])
    slope = f32(0.5) * f32(4) * grid.pitch(near)
    members = [
        s
        for s in samples
        if s[0] >= near
        and s[0] - near
        <= f32(0.03) + slope * np.sqrt(f32(4 * ((s[1] - x0) ** 2 + (s[2] - y0) ** 2)))
    ]
    start = next(k for k, s in enumerate(members) if s[:3] == first[:3])
    return near, max(s[0] for s in members), members, start


def _surrounds(members):
    return surrounded({sector(s[1], s[2]) for s in members}, 18)


def _filled(near, far, members, start):
    """The plane of a layer, and its sample nearest to the middle."""
    order = [members[start], *members[:start], *members[start + 1 :]]
    return (_plane(members), near, far), min(order, key=lambda s: s[1] ** 2 + s[2] ** 2)


def _thickened(near, far):
    """The depths of a layer with half its thickness more on either side."""
    beyond = f32(0.5) * (far - near)
    return max(near - beyond, f32(0.5) * near), far + beyond


def _layer(samples, grid):
    """The plane, with its nearest and farthest depth, and the closest sample, of what surrounds or
    else is closest; and the state. None without one, or where that is in doubt."""
    beyond = f32(0)
    for _ in range(3):
        layer = _layer_from(samples, beyond, grid)
        if layer is None:
            break
        if _surrounds(layer[2]):
            return _layer_round(_filled(*layer)[1], samples, grid), FILLED
        beyond = layer[1]
    near_enough = [s for s in samples if s[3][0] <= f32(s[3][1])]
    if not near_enough:
        return None, FILLED_BORDER
    closest = min(near_enough, key=lambda s: (s[3][0], s[0]))
    _, x, y, (way, spacing) = closest
    depths = [s[0] for s in samples]
    doubt = f32(2) * way * (max(depths) - min(depths))
    if x * x + y * y > 2.5 and doubt > f32(0.16) * f32(2 * spacing) * max(depths):
        return None, FILLED_BORDER
    return _layer_round(closest, samples, grid), FILLED_BORDER


def _layer_round(closest, samples, grid):
    """The plane of what lies little before or behind a sample, with its depths, and the sample."""
    z, x, y, _ = closest
    slope = f32(0.5) * f32(4) * grid.pitch(z)
    members = [
        s
        for s in samples
        if abs(s[0] - z)
        <= f32(0.03) + slope * np.sqrt(f32(4 * ((s[1] - x) ** 2 + (s[2] - y) ** 2)))
    ]
    depths = [s[0] for s in members]
    return (_plane(members), *_thickened(min(depths), max(depths))), closest


def _plane(members):
    """(a, b, c) of 1/z = a + b x + c y by least squares, weights 1 / (d^2 + 0.25)."""
    w, x, y, q, xx, xy, yy, xq, yq = (f32(0) for _ in range(9))
    for z, right, down, _ in members:
        u, v, p = f32(right), f32(down), f32(1) / z
        weight = f32(1) / (u * u + v * v + f32(0.25))
        w, x, y, q = w + weight, x + weight * u, y + weight * v, q + weight * p
        xx, xy, yy = xx + weight * (u * u), xy + weight * (u * v), yy + weight * (v * v)
        xq, yq = xq + weight * (u * p), yq + weight * (v * p)
    x, y, q = x / w, y / w, q / w
    xx, xy, yy = xx / w - x * x + f32(0.05), xy / w - x * y, yy / w - y * y + f32(0.05)
    xq, yq = xq / w - x * q, yq / w - y * q
    determinant = xx * yy - xy * xy
    b, c = (xq * yy - yq * xy) / determinant, (yq * xx - xq * xy) / determinant
    return q - b * x - c * y, b, c


def nearest_fill(maps: Maps, grid: Grid, radius: int) -> Maps:
    """An empty pixel takes the nearest pixel's depth; ties: smallest depth, then lowest index."""
    depth, index, state = maps
    depth_out, index_out, state_out = (array.copy() for array in maps)
    rows, columns = depth.shape
    there = present(depth, state)
    for row, column in np.argwhere(~there):
        found = []
        for y in range(-radius, radius + 1):
            for x in range(-radius, radius + 1):
                c = grid.column(column + x, columns)
                inside = x * x + y * y <= radius * radius
                if inside and 0 <= row + y < rows and c >= 0 and there[row + y, c]:
                    found.append((x * x + y * y, depth[row + y, c], index[row + y, c]))
        if found:
            _, depth_out[row, column], index_out[row, column] = min(found)
            state_out[row, column] = FILLED
    return depth_out, index_out, state_out


def push_pull(maps: Maps) -> Maps:
    """Averages of inverse depth over areas of 1 to 32 pixels a side, brought back."""
    depth, index, state = maps
    depth_out, index_out, state_out = (array.copy() for array in maps)
    there = present(depth, state)
    with np.errstate(divide="ignore", invalid="ignore"):
        q = np.where(there, f32(1) / depth, f32(0)).astype(f32)
    numbers = np.arange(depth.size).reshape(depth.shape)
    levels = [(q, there.astype(f32), np.where(there, numbers, -1))]
    for _ in range(5):
        levels.append(_pulled(*levels[-1]))
    for level in reversed(range(5)):
        _push(levels[level], levels[level + 1])
    q, _, source = levels[0]
    for row, column in np.argwhere(~there & (source >= 0)):
        depth_out[row, column] = f32(1) / q[row, column]
        index_out[row, column] = index.flat[source[row, column]]
        state_out[row, column] = FILLED
    return depth_out, index_out, state_out


def _pulled(q, weight, source):
    rows, columns = q.shape
    size = ((rows + 1) // 2, (columns + 1) // 2)
    result = np.zeros(size, f32), np.zeros(size, f32), np.full(size, -1)
    for row, column in np.ndindex(size):
        total, inverse, largest = f32(0), f32(0), f32(0)
        for k in range(4):
            r, c = 2 * row + k // 2, 2 * column + k % 2
            if r < rows and c < columns:
                total, inverse = total + weight[r, c], inverse + weight[r, c] * q[r, c]
                if source[r, c] >= 0 and q[r, c] > largest:
                    largest = q[r, c]
                    result[2][row, column] = source[r, c]
        result[0][row, column] = inverse / total if total > 0 else 0
        result[1][row, column] = min(total, f32(1))
    return result


def _push(fine, coarse) -> None:
    q, weight, source = fine
    for row, column in np.argwhere(weight < 1):
        total, inverse = f32(0), f32(0)
        for k in range(4):
            r = row // 2 + (k // 2) * (2 * (row % 2) - 1)
            c = column // 2 + (k % 2) * (2 * (column % 2) - 1)
            if 0 <= r < coarse[0].shape[0] and 0 <= c < coarse[0].shape[1]:
                share = f32((3 - 2 * (k // 2)) * (3 - 2 * (k % 2)))
                total = total + share * coarse[1][r, c]
                inverse = inverse + share * coarse[1][r, c] * coarse[0][r, c]
                if source[row, column] < 0:
                    source[row, column] = coarse[2][r, c]
        if total > 0:
            own = weight[row, column]
            q[row, column] = own * q[row, column] + (f32(1) - own) * (inverse / total)
            weight[row, column] = 1
