"""`python -m swarm.scenario docs` writes the scenario reference and the JSON schema into the folder `docs`."""

import sys
from pathlib import Path

from swarm.scenario.reference import write

if __name__ == "__main__":
    write(Path(sys.argv[1] if len(sys.argv) > 1 else "docs"))
