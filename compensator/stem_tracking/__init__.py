"""Where the stem stands and what its friction, load and noise are: hypotheses judged by PV."""
