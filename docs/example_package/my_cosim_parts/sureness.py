"""How sure is the run where it is right, and where it is wrong?"""

from isac_cosim.base.settings import Settings
from isac_cosim.evaluation.on_windows.results import EvaluationResult
from isac_cosim.evaluation.report.parts import Part


class Sure(Settings):
    right: float
    wrong: float


class Sureness:
    result_class = EvaluationResult

    def measure(self, evaluation):
        predictions = evaluation.measured[0].predictions
        known = predictions.known
        right = (predictions.predicted == predictions.label)[known]
        highest = predictions.outputs.probabilities[known].max(axis=1)
        if right.all() or not right.any():
            return None
        return Sure(right=highest[right].mean(), wrong=highest[~right].mean())

    def parts(self, shown):
        answer = shown.answers.get("sureness")
        if answer is None:
            return []
        rows = [{"where the run is": name, "mean probability": answer[name]} for name in ("right", "wrong")]
        return [Part("sureness", "How sure is the run?", "The probability of the likeliest intention.", rows)]


SURENESS = Sureness()
