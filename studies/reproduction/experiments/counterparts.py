"""Every figure and table of both papers: where its counterpart stands on the page, or why there is none."""

from __future__ import annotations

from dataclasses import dataclass

from isac_cosim.evaluation.report.parts import Part, Row


@dataclass(frozen=True)
class Counterpart:
    """A figure or table of a paper.

    source: its number. shows: what it shows. here: name of the part of our page; None where there is none. why: why
    there is none, or what ours leaves out.
    """

    source: str
    shows: str
    here: str | None
    why: str = ""


ASI_BIP = (
    Counterpart("Fig. 1", "the scenario", None, "a drawing without results"),
    Counterpart(
        "Fig. 2", "the network", None, "a drawing without results; `models/predictors/asi_bip.py` is the network"
    ),
    Counterpart("Fig. 3(a)", "loss by epoch", "fig3"),
    Counterpart("Fig. 3(b)", "accuracy by epoch", "fig3"),
    Counterpart("Fig. 3(c)", "confusion, F1 of three intentions", "fig3", "the paper prints no counts"),
    Counterpart("Fig. 4(a)", "ROC of the unknown class", "fig4", "of each intention alone where a run has stored it"),
    Counterpart("Fig. 4(b)", "confidence of known and unknown", "fig4"),
    Counterpart("Fig. 4(c)", "confusion at a threshold", "fig4", "the paper gives neither threshold nor counts"),
    Counterpart("Fig. 5", "F1 of each intention by SNR", "fig5", "the paper's is from -10 to 20 dB, without numbers"),
    Counterpart("Table I", "five ways of sensing", "table1"),
)
CASTFORMER = (
    Counterpart("Fig. 1", "earlier methods and this one", None, "a drawing without results"),
    Counterpart("Fig. 2", "the network", None, "a drawing; `models/predictors/castformer.py` is the network"),
    Counterpart("Fig. 3", "the attention", None, "a drawing; `models/networks/castformer_modules.py` is the attention"),
    Counterpart(
        "Table 1",
        "precision and recall, with and without speed",
        "table1",
        "our states hold the velocity of both vehicles, so there is no variant without speed; other methods read "
        "video, GPS or maps, and are shown as printed",
    ),
    Counterpart(
        "Table 2",
        "F1 and parameters, inside or outside alone",
        "table2",
        "inside or outside alone is of networks on raw video, which are shown as printed",
    ),
    Counterpart("Fig. 4", "confusion", "fig4", "the paper's counts, and those of TIFN, are in a picture"),
    Counterpart("Table 3", "observation that ends early", "horizon", "other methods as printed"),
    Counterpart("Table 4", "modules", "ablation"),
    Counterpart("Fig. 5", "attention", "attention", "the paper prints no numbers"),
    Counterpart("Table 5", "order of the modules", "orders"),
    Counterpart("Fig. 6", "weight of the intention's loss", "alpha", "the paper prints no numbers"),
    Counterpart(
        "Abstract",
        "transparency",
        None,
        "the paper has no figure of it; `cosim evaluate RUN --data DATASET --explain` shows attention, gates and "
        "weights",
    ),
)


def counterparts_part(counterparts: tuple[Counterpart, ...], parts: list[Part]) -> Part:
    """Return the list of a paper's figures and tables; parts: those of the page."""
    titles = {part.name: part.title for part in parts}
    rows: list[Row] = [
        {
            "in the paper": item.source,
            "shows": item.shows,
            "here": None if item.here is None else titles.get(item.here, f"stage {item.here}, not run"),
            "remark": item.why or None,
        }
        for item in counterparts
    ]
    return Part("counterparts", "Where each figure and table is", "Of the paper, in its order.", rows)
