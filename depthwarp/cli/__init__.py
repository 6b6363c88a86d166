"""The command line: `depthwarp render`, `info`, `doctor`, `demo`."""
