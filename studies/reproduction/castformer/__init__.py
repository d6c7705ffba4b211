"""The experiments of the CaSTFormer paper."""
