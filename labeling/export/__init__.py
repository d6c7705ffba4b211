"""Episodes and records for other programs: floating car data that SUMO replays, and tables as CSV."""
