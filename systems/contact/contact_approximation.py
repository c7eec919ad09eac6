"""Drake's approximations of contact within a step of a plant, by the names of the scenarios.

All but ``sap`` have Hunt and Crossley's normal force. ``lagged`` bounds friction by the normal
force that it expects before the step, ``tamsi`` by the one that it finds, and neither lets a
contact that slides come apart, as ``similar`` and ``sap`` do (README.md).
"""

from typing import Literal

from pydrake.multibody.plant import DiscreteContactApproximation, MultibodyPlant

Convex = Literal["lagged", "similar", "sap"]
Approximation = Literal["lagged", "similar", "sap", "tamsi"]


def approximate(plant: MultibodyPlant, approximation: Approximation) -> None:
    """Set how a plant that is not finalized, if it has steps, solves its contacts.

    With ``tamsi``, which Drake will remove, it passes over the gains of its actuators.
    """
    if plant.time_step():
        kind = getattr(DiscreteContactApproximation, f"k{approximation.capitalize()}")
        plant.set_discrete_contact_approximation(kind)
