"""The commands of `swarm`, a file each: parsing and printing, nothing else; `swarm.cli.app` puts them together."""
