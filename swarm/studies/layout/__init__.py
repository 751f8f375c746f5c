"""Where a craft's photodiodes should sit: candidates on its hull, the search, the judgement, and what is written."""
