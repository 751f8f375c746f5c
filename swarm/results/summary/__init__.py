"""The summary of a run: figures per craft and for the swarm, from its telemetry."""

from swarm.results.summary.chi_square import autocorrelation_time, consistency
from swarm.results.summary.figures import Account
from swarm.results.summary.summarise import summarise, summarise_run

__all__ = ["Account", "autocorrelation_time", "consistency", "summarise", "summarise_run"]
