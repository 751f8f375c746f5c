"""The version of the program as it is installed."""

from importlib.metadata import PackageNotFoundError, version

try:
    VERSION = version("lighthouse-swarm")
except PackageNotFoundError:
    VERSION = "0+unknown"
