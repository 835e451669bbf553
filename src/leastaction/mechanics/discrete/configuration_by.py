"""How an assembled configuration follows the numbers of its mechanism."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from leastaction.mechanics.configuration.assembly import check_consistent
from leastaction.mechanics.discrete.midpoint import MidpointVI
from leastaction.mechanics.discrete.sensitivity import start_by
from leastaction.mechanics.mechanism.arguments import single
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array, Row, require_instance
from leastaction.numerics.names import as_names
from leastaction.numerics.public import public


@public
def configuration_by(mechanism: Mechanism, q: Row, names: Sequence[str], *, hold: Sequence[str] = ()) -> Array:
    """Return the derivatives (nv, len(names)) of an assembled configuration by parameters.

    As `project_configuration` closes the constraints again from q when a length changes a little: the variables
    change by as little as they have to, quaternions by turns in their own axes. Kinematic variables stay.

    Parameters
    ----------
    mechanism : Mechanism
    q : array_like, shape (nq,)
        Configuration on the constraints.
    names : sequence of str
        Parameters, among the names of `Mechanism.parameters`, such as ``"rod.length"`` or ``"link.value"``.
    hold : sequence of str, optional
        Variables that keep their values.

    Raises
    ------
    ArgumentError
        For wrong shapes or unknown names, or where with some held nothing keeps a constraint.
    InconsistentStartError
        If q violates the constraints.
    """
    require_instance(mechanism, "mechanism", Mechanism)
    m = mechanism
    place = single(m, q)
    check_consistent(m, place)
    held = as_names(hold, "hold", "variables")
    wanted = as_names(names, "names", "parameters")
    m.parameter_places(m.members_of(wanted)[0])
    out = np.zeros((m.nv, len(wanted)))
    if m.nc and wanted:
        out[: m.nd] = start_by(MidpointVI(m, threads=1), place, wanted, held)
    return out
