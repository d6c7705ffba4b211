"""What is asked of decisions, and how answers are numbered."""

from isac_cosim.labeling.intentions import KNOWN, Intention

WITH_HAZARD = tuple(intention for intention in KNOWN if intention is not Intention.OVERTAKE)
"""The intentions that have a hazard, in the order of its columns."""
IGNORED = -1
"""The answer to decisions that nothing is learned from: neutral events, and the time after a commit."""
