"""The spring-mass-damper plant as a block."""

from pydrake.systems.primitives import LinearSystem

from chamfer.models.plants.spring_mass_damper import Form, SpringMassDamperParams, state_space


def make_spring_mass_damper(params: SpringMassDamperParams, form: Form) -> LinearSystem:
    """Return the plant as a continuous linear system with one input and one output.

    The forms and their units are those of
    :func:`chamfer.models.plants.spring_mass_damper.state_space`; the state is (position m,
    velocity m/s).
    """
    plant = LinearSystem(*state_space(params, form))
    plant.set_name("plant")
    return plant
