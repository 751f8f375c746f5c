"""Entry point of `python -m swarm`, which is the command `swarm`."""

import sys

from swarm.cli.app import main

if __name__ == "__main__":
    sys.exit(main())
