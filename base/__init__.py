"""What every package rests on: errors, files, settings, registries, random streams, progress, workers."""
