from leastaction.identification.experiment import Experiment
from leastaction.identification.least_squares import identify
from leastaction.identification.result import Identification

__all__ = ["Experiment", "Identification", "identify"]
