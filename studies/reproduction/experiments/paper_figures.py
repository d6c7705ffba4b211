"""Numbers that the papers print, to stand beside ours."""

from __future__ import annotations

CASES = {
    1: (0.9233, 0.9249),
    2: (0.8708, 0.8642),
    3: (0.8750, 0.8761),
    4: (0.8642, 0.8660),
    5: (0.7917, 0.7758),
}
"""Accuracy and macro-F1 by the number of the case. Source: ASI-BIP, Table I."""
CLASS_F1 = {"hard_brake": 0.7568, "overtake": 1.0, "hard_accel": 0.9333}
"""F1 of the intentions whose value the text gives. Source: ASI-BIP, Section IV-B."""
UNKNOWN_AUROC = 0.6994
"""Separation of `following`. Source: ASI-BIP, Section IV-C."""
WEATHER_GAIN = 0.114
"""Relative gain of ISAC's macro-F1 over the radar's in adverse weather. Source: ASI-BIP, Section IV-D."""

HORIZONS_S = (0, 1, 2, 3, 4)
"""How long before the action the observation ends, s. Source: CaSTFormer, Table 3."""
HORIZON = {
    "CaSTFormer": (98.6, 97.4, 90.1, 78.4, 63.7),
    "IDIPN": (94.5, 84.1, 74.2, 62.0, 55.4),
    "TIFN": (87.9, 80.9, 71.0, 55.0, 44.6),
}
"""F1 in percent at each of HORIZONS_S, by method. Source: CaSTFormer, Table 3."""
ABLATION = {
    "": (95.8, 94.2, 85.4, 73.7, 63.2),
    "rsf": (97.1, 95.6, 87.1, 75.2, 61.9),
    "cpe": (97.0, 95.4, 86.9, 74.9, 61.1),
    "fsn": (96.6, 94.9, 86.3, 73.9, 62.6),
    "rsf+cpe": (97.4, 95.7, 87.4, 75.9, 60.3),
    "rsf+fsn": (98.0, 96.7, 88.5, 76.8, 65.6),
    "cpe+fsn": (97.8, 96.4, 88.0, 76.2, 62.4),
    "rsf+cpe+fsn": (98.6, 97.4, 90.1, 78.4, 63.7),
}
"""The same, by the modules that are on. Source: CaSTFormer, Table 4."""
ORDERS = {
    "rsf-cpe-fsn": (98.6, 97.4, 90.1, 76.2, 62.3),
    "cpe-rsf-fsn": (97.0, 95.3, 87.9, 79.2, 65.3),
    "rsf-fsn-cpe": (97.6, 95.6, 86.7, 76.9, 64.2),
    "cpe-fsn-rsf": (97.3, 95.7, 86.0, 75.7, 62.8),
}
"""The same, by the order of the modules. Source: CaSTFormer, Table 5."""
BEST_ALPHA = 0.1
"""Weight of the intention's loss that the paper finds best. Source: CaSTFormer, Fig. 6, which has no numbers."""


def end_of(horizon_s: int) -> str:
    """Return where an observation ends, as the paper writes it."""
    return f"-{horizon_s} s" if horizon_s else "0 s"


def contradictions() -> list[str]:
    """Return, in words, where the tables of the CaSTFormer paper contradict each other on the complete network.

    Tables 3 and 4 print the same network as the first row of Table 5.
    """
    complete, first_row = HORIZON["CaSTFormer"], ORDERS["rsf-cpe-fsn"]
    sentences = []
    for horizon_s, of_tables, of_order in zip(HORIZONS_S, complete, first_row, strict=True):
        if of_tables != of_order:
            others = [order for order, row in ORDERS.items() if row[horizon_s] > of_order]
            sentences.append(
                f"At -{horizon_s} s, Tables 3 and 4 give the complete network {of_tables} %, but Table 5 gives the "
                f"same network {of_order} %, below the order {' and '.join(others)}."
            )
    return sentences
