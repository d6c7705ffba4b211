"""Numbers that the papers print, to stand beside ours."""

from __future__ import annotations

from itertools import pairwise

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
    "Rong, inside": (75.7, 73.1, 68.6, 58.5, 48.2),
    "Rong, outside": (66.4, 62.4, 47.0, 38.8, 38.9),
    "Rong, both": (84.3, 78.9, 70.6, 60.3, 53.4),
    "TIFN": (87.9, 80.9, 71.0, 55.0, 44.6),
    "IDIPN": (94.5, 84.1, 74.2, 62.0, 55.4),
    "CaSTFormer": (98.6, 97.4, 90.1, 78.4, 63.7),
}
"""F1 in percent at each of HORIZONS_S, by method. Source: CaSTFormer, Table 3."""
PRECISION_RECALL = {
    "IOHMM": (74.2, 71.2, 72.7),
    "SDAE": (71.9, 74.8, 73.3),
    "AIO-HMM": (77.4, 71.2, 74.2),
    "Deep CNN": (78.0, 77.5, 77.7),
    "FRNN-UL": (82.2, 75.9, 78.9),
    "FRNN-EL": (84.5, 77.1, 80.6),
    "FRNN-EL, 3D head pose": (90.5, 87.4, 88.9),
    "LSTM-GRU": (92.3, 90.8, 91.3),
    "DCNN": (91.8, 92.5, 92.1),
    "CF-LSTM": (92.0, 92.3, 92.1),
    "Predictive-Bi-LSTM-CRF": (92.4, 94.7, 93.6),
    "Central": (94.4, 94.3, 94.2),
    "FedPRM": (99.0, 92.0, 95.2),
    "Gebert": (None, None, 81.7),
    "Rong": (None, None, 84.3),
    "CEMFormer": (None, None, 87.1),
    "TIFN": (89.3, 86.4, 87.9),
    "IDIPN": (94.2, 94.9, 94.5),
    "CaSTFormer, without speed": (96.7, 98.5, 97.6),
    "CaSTFormer": (98.7, 98.5, 98.6),
}
"""Precision, recall and F1 in percent, by method. Source: CaSTFormer, Table 1."""
STREAMS = (
    ("Gebert", "inside", 81.7, "85.3+162"),
    ("Gebert", "outside", 43.4, "85.3+162"),
    ("Gebert", "both", 73.2, "170.5+162"),
    ("Rong", "inside", 75.5, "46.2+162"),
    ("Rong", "outside", 66.4, "5.4+162"),
    ("Rong", "both", 84.3, "57.9+162"),
    ("TIFN", "both", 87.9, "12.3+5.3"),
    ("IDIPN", "both", 94.5, "11.75+5.3"),
    ("CaSTFormer", "both", 98.6, "14.53+5.3"),
)
"""Method, streams, F1 in percent, parameters in millions (network + optical flow). Source: CaSTFormer, Table 2."""
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
    """Return, in words, where the CaSTFormer paper contradicts itself.

    Tables 3 and 4 print the same network as the first row of Table 5.
    """
    return [*_of_the_complete_network(), *_of_the_text(), *_of_precision_and_recall()]


def _of_the_text() -> list[str]:
    """Return where the text says something else than the tables."""
    row = HORIZON["CaSTFormer"]
    steps = [round(near - far, 1) for near, far in pairwise(row)]
    furthest, baseline = len(HORIZONS_S) - 1, ABLATION[""]
    below = [name.upper() for name, scores in ABLATION.items() if name and scores[furthest] < baseline[furthest]]
    return [
        f"The text says that F1 declines nearly linearly. From second to second, it falls by "
        f"{', '.join(map(str, steps[:-1]))} and {steps[-1]} points in Table 3.",
        f"The text finds consistent improvements in all configurations. At {end_of(HORIZONS_S[furthest])}, "
        f"{len(below)} of {len(ABLATION) - 1} are below the baseline's {baseline[furthest]} % in Table 4: "
        f"{', '.join(below)}.",
    ]


def _of_precision_and_recall() -> list[str]:
    """Return where the tables give one network two scores."""
    without, with_speed = PRECISION_RECALL["CaSTFormer, without speed"][2], PRECISION_RECALL["CaSTFormer"][2]
    rong = next(f1 for method, streams, f1, _ in STREAMS if (method, streams) == ("Rong", "inside"))
    return [
        f"Table 2 compares methods on the two video streams and gives CaSTFormer {with_speed} %. By Table 1, that is "
        f"with the speed; without it, CaSTFormer has {without} %.",
        f"Rong on the inside stream has {rong} % in Table 2, and {HORIZON['Rong, inside'][0]} % in Table 3.",
    ]


def _of_the_complete_network() -> list[str]:
    """Return where Tables 3 and 4 give the complete network another score than Table 5."""
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
