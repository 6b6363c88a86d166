"""LZF decompression (M. Lehmann's LibLZF scheme), as in the bodies of compressed PCD files."""

import warp as wp

wp.set_module_options({"enable_backward": False})

LZF_OK = wp.constant(0)
LZF_INPUT_ENDS = wp.constant(1)
LZF_OUTPUT_FULL = wp.constant(2)
LZF_REFERS_BEFORE_START = wp.constant(3)


# One item does it all: every byte may repeat one just written. A control byte below 32 is followed
# by that many + 1 plain bytes; any other holds a length (3 bits; 7 = one more byte follows) and
# the high bits of a distance, whose low byte comes last; length + 2 bytes are repeated from
# distance + 1 bytes back. Sizes are below 2^31, and no sum of a size and a length is formed, so
# that nothing overflows; every access is checked first, whatever the input holds.
@wp.kernel
def lzf_decompress(
    # In:
    compressed: wp.array[wp.uint8],
    # Out:
    data_out: wp.array[wp.uint8],
    status_out: wp.array[wp.int32],
    written_out: wp.array[wp.int32],
):
    end = compressed.shape[0]
    capacity = data_out.shape[0]
    read = int(0)
    written = int(0)
    status = int(LZF_OK)
    while read < end and status == LZF_OK:
        control = int(compressed[read])
        read += 1
        if control < 32:
            length = control + 1
            if length > end - read:
                status = LZF_INPUT_ENDS
            elif length > capacity - written:
                status = LZF_OUTPUT_FULL
            else:
                for k in range(length):
                    data_out[written + k] = compressed[read + k]
                read += length
                written += length
        else:
            length = control >> 5
            needed = int(1)
            if length == 7:
                needed = int(2)
            if needed > end - read:
                status = LZF_INPUT_ENDS
            else:
                if length == 7:
                    length += int(compressed[read])
                length += 2
                distance = ((control & 31) << 8) + int(compressed[read + needed - 1]) + 1
                read += needed
                if distance > written:
                    status = LZF_REFERS_BEFORE_START
                elif length > capacity - written:
                    status = LZF_OUTPUT_FULL
                else:
                    for k in range(length):
                        data_out[written + k] = data_out[written + k - distance]
                    written += length
    status_out[0] = status
    written_out[0] = written
