"""Which blocks of a prepared cloud the splat for CPUs has to draw, and the counts of the others."""

from functools import cache

import warp as wp

from depthwarp_kernels.options import EXACT
from depthwarp_kernels.packed_points import PACKED
from depthwarp_kernels.point_source import (
    ALL_BEHIND,
    ALL_DRAWN,
    ALL_OUTSIDE,
    BLOCK,
    GROUP,
    NONE_IN_VIEW,
    SEEN,
)
from depthwarp_kernels.splat import BEHIND, OUTSIDE, SplatConfig, verdict_function
from depthwarp_kernels.view import View, to_camera


# In C for the reason that `nearest` gives: it is what a view asks most of the blocks it cannot see.
# The operations are those of `to_camera`, in its order; `forward` is the rotation's first row.
@wp.func_native(f"""
    int ahead = 0;
    for (int k = 0; k < {BLOCK}; ++k) {{
        const float dx = x.data[begin + k] - position[0];
        const float dy = y.data[begin + k] - position[1];
        const float dz = z.data[begin + k] - position[2];
        ahead += ((forward[0] * dx + forward[1] * dy) + forward[2] * dz) - shift > 0.0f;
    }}
    return ahead;
""")
def points_ahead(
    x: wp.array[wp.float32],
    y: wp.array[wp.float32],
    z: wp.array[wp.float32],
    begin: wp.int32,
    forward: wp.vec3f,
    position: wp.vec3f,
    shift: wp.float32,
) -> wp.int32:
    """Points of a block with X > 0; what fills up the last block has no X."""
    ...


@cache
def cull_kernel(config: SplatConfig):
    """Kernel, for one thread, that lists the blocks a view may see and counts the others' points.

    They are those of `groups` groups of blocks from `first` on; the cloud holds `count` points. A
    block b of which every point is drawn is listed as -1 - b. The list's last place has its length.
    """
    Source = config.source.struct
    sphere_of, group_of = config.source.sphere_of, config.source.group_of
    verdict_of = verdict_function(config)
    point_at, is_packed = config.source.point_at, config.source is PACKED
    Word = wp.uint32 if is_packed else wp.float32

    @wp.func
    def packed_ahead(view: View, source: Source, begin: wp.int32):
        """The same of a packed block."""
        ahead = int(0)
        for k in range(wp.static(BLOCK)):
            p = to_camera(point_at(source, begin + k), view.rotation, view.position, view.shift)
            ahead += wp.where(p[0] > 0.0, 1, 0)
        return ahead

    @wp.kernel(module="unique", module_options=EXACT, enable_backward=False)
    def cull_blocks(
        # In:
        views: wp.array[View],
        v: wp.int32,
        source: Source,
        x: wp.array[Word],
        y: wp.array[Word],
        z: wp.array[Word],
        first: wp.int32,
        groups: wp.int32,
        count: wp.int32,
        # Out:
        seen_out: wp.array[wp.int32],
        counts_out: wp.array[wp.int64],
    ):
        view = views[v]
        length = int(0)
        behind = int(0)
        outside = int(0)
        blocks = (count + wp.static(BLOCK - 1)) / wp.static(BLOCK)
        for group in range(first, first + groups):
            begin = group * wp.static(GROUP)
            end = wp.min(begin + wp.static(GROUP), blocks)
            held = wp.min(end * wp.static(BLOCK), count) - begin * wp.static(BLOCK)
            of_group = verdict_of(view, group_of(source, group))
            if of_group == ALL_BEHIND:
                behind += held
                begin = end
            elif of_group == ALL_OUTSIDE:
                outside += held
                begin = end
            for block in range(begin, end):
                verdict = of_group
                if of_group != ALL_DRAWN:
                    verdict = verdict_of(view, sphere_of(source, block))
                held = wp.min(wp.static(BLOCK), count - block * wp.static(BLOCK))
                if verdict == ALL_DRAWN and held == wp.static(BLOCK):
                    seen_out[length] = -1 - block
                    length += 1
                elif verdict == SEEN or verdict == ALL_DRAWN:
                    seen_out[length] = block
                    length += 1
                else:
                    ahead = wp.where(verdict == ALL_OUTSIDE, held, 0)
                    if verdict == NONE_IN_VIEW:
                        if wp.static(is_packed):
                            ahead = packed_ahead(view, source, block * wp.static(BLOCK))
                        else:
                            ahead = points_ahead(
                                x,
                                y,
                                z,
                                block * wp.static(BLOCK),
                                view.rotation[0],
                                view.position,
                                view.shift[0],
                            )
                    behind += held - ahead
                    outside += ahead
        seen_out[seen_out.shape[0] - 1] = length
        counts_out[BEHIND] = counts_out[BEHIND] + wp.int64(behind)
        counts_out[OUTSIDE] = counts_out[OUTSIDE] + wp.int64(outside)

    return cull_blocks
