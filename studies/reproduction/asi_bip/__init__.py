"""The experiments of the ASI-BIP paper."""
