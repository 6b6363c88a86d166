"""Module options that every kernel file shares."""

# Without contraction of a*b+c, + - * / and sqrt round alike on a CPU and on CUDA: same bits.
EXACT = {"enable_backward": False, "fuse_fp": False}
