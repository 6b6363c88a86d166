"""Device side of depthwarp: Warp structs, functions and kernels, one file a kernel family.

The host package `depthwarp` validates, allocates and launches; nothing here imports it.
"""
