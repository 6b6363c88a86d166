"""`python -m depthwarp` is the program `depthwarp`."""

from depthwarp.cli.main import main

main()
