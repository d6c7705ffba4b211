"""What a result says of test samples that are not independent of those trained on."""

from __future__ import annotations

from isac_cosim.evaluation.on_windows.results import EvaluationResult
from isac_cosim.evaluation.report.parts import Part, Shown
from isac_cosim.models.data.sides import warning


class DependentSeeds:
    """A warning beside the headline where test samples have twins among those that were trained on."""

    result_class = EvaluationResult

    def parts(self, shown: Shown) -> list[Part]:
        result: EvaluationResult = shown.result
        line = warning(result.dependence)
        return [] if line is None else [Part("dependent-seeds", sentences=[line])]
