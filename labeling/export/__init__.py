"""Episodes and records for other programs: floating car data that SUMO replays, CSV tables, scenes for Foxglove."""
