"""Drake's approximations of contact within a step; README.md lists the errors of each."""

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
