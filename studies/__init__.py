"""Bundled studies: one TOML file describes one study, end to end."""
