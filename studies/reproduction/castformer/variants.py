"""The networks that the CaSTFormer paper compares: by its modules, their order, the attention and the loss."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import combinations
from typing import Any

from isac_cosim.studies.reproduction.experiments.paper_figures import BEST_ALPHA

MODULES = ("rsf", "cpe", "fsn")
ATTENTIONS = ("bda", "self", "joint", "one_way")
ORDERS = ("rsf-cpe-fsn", "cpe-rsf-fsn", "rsf-fsn-cpe", "cpe-fsn-rsf")
PAPER = {"intent_source": "out"}
"""Settings of the network that are the paper's, not this project's: Eq. (9) reads the intention from `out`."""


@dataclass(frozen=True)
class Variant:
    """A network to compare.

    name: usable in a path; variants of the same name are the same network. title: for people. model: the predictor.
    castformer: settings that differ from the paper's.
    """

    name: str
    title: str
    model: str = "castformer"
    castformer: dict[str, Any] = field(default_factory=dict)

    @property
    def settings(self) -> dict[str, Any]:
        """Settings of the network that are not the project's default."""
        return {**PAPER, **self.castformer}


COMPLETE = Variant("complete", "CaSTFormer")


def horizon() -> list[Variant]:
    """Return the variants of Table 3: the complete network alone."""
    return [COMPLETE]


def ablation() -> list[Variant]:
    """Return the variants of Table 4: every combination of the three modules, the baseline first."""
    variants = []
    for count in range(len(MODULES) + 1):
        for modules in combinations(MODULES, count):
            if modules == MODULES:
                variants.append(COMPLETE)
                continue
            switched = {module: module in modules for module in MODULES}
            name = "+".join(modules) or "none"
            title = " + ".join(["T-Base", *(module.upper() for module in modules)])
            variants.append(Variant(f"modules-{name}", title, castformer=switched))
    return variants


def repeat_stage(seed: int | str) -> str:
    """Return the name of the stage that repeats the main comparison with another training seed; `*` stands for any."""
    return f"repeat-{seed}"


def main_comparison() -> list[Variant]:
    """Return the variants of Table 4 that its claims are about: the baseline, each module alone, and all of them."""
    return [row for row in ablation() if sum(row.settings.get(module, True) for module in MODULES) in (0, 1, 3)]


def attention() -> list[Variant]:
    """Return the variants of Fig. 5: what RSF attends to."""
    return [
        COMPLETE if kind == "bda" else Variant(f"attention-{kind}", f"attention {kind}", castformer={"attention": kind})
        for kind in ATTENTIONS
    ]


def orders() -> list[Variant]:
    """Return the variants of Table 5: the order of the modules."""
    return [
        COMPLETE if order == ORDERS[0] else Variant(f"order-{order}", order, castformer={"order": order})
        for order in ORDERS
    ]


def counterfactuals() -> list[Variant]:
    """Return two readings of Eq. (6): the counterfactual's mean over the window's own past, and over the batch."""
    return [COMPLETE, Variant("mean-over-batch", "mean over the batch", castformer={"mean_over": "batch"})]


def alphas(values: tuple[float, ...]) -> list[Variant]:
    """Return the variants of Fig. 6: the weight of the intention's loss."""
    return [
        COMPLETE
        if alpha == BEST_ALPHA
        else Variant(f"alpha-{alpha:g}", f"alpha {alpha:g}", castformer={"alpha": alpha})
        for alpha in values
    ]


def compared(models: tuple[str, ...]) -> list[Variant]:
    """Return the complete network and other predictors, on the same windows and folds."""
    return [COMPLETE, *(Variant(model, model, model) for model in models)]
