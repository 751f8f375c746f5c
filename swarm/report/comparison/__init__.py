"""The comparison of several runs: what differs in their scenarios, and their figures beside each other."""
