"""Links of a connector whose pieces touch some links and pass through others, as a URDF."""

from collections.abc import Mapping, Sequence

from pydrake.geometry import Box, Cylinder, Shape, Sphere
from pydrake.math import RollPitchYaw

from models.connectors.connector import Material, Piece


def filtered_links(
    name: str,
    links: Mapping[str, Sequence[Piece]],
    ignored: Mapping[str, Sequence[str]],
    materials: Mapping[str, Material],
) -> str:
    """Return the text of a URDF of links without mass and joints, to be touched but not seen.

    Args:
        name: Of the model.
        links: Pieces of each link, in its frame: spheres, boxes and cylinders.
        ignored: The links that each link passes through; one way is enough.
        materials: Of each link.
    """
    lines = [f'<robot name="{name}" xmlns:drake="http://drake.mit.edu">']
    for link, pieces in links.items():
        lines.append(f'<link name="{link}">')
        lines.extend(_collision(piece, materials[link]) for piece in pieces)
        lines.append("</link>")
    for link in links:
        lines.append(f'<drake:collision_filter_group name="{link}">')
        lines.append(f'<drake:member link="{link}"/>')
        lines.extend(
            f'<drake:ignored_collision_filter_group name="{other}"/>'
            for other in ignored.get(link, ())
        )
        lines.append("</drake:collision_filter_group>")
    lines.append("</robot>")
    return "\n".join(lines)


def _collision(piece: Piece, material: Material) -> str:
    rpy = " ".join(repr(float(x)) for x in RollPitchYaw(piece.X_BP.rotation()).vector())
    xyz = " ".join(repr(float(x)) for x in piece.X_BP.translation())
    return (
        f'<collision name="{piece.name}"><origin xyz="{xyz}" rpy="{rpy}"/>'
        f"<geometry>{_geometry(piece.shape)}</geometry><drake:proximity_properties>"
        f'<drake:point_contact_stiffness value="{material.stiffness!r}"/>'
        f'<drake:hunt_crossley_dissipation value="{material.dissipation!r}"/>'
        f'<drake:mu_static value="{material.friction!r}"/>'
        f'<drake:mu_dynamic value="{material.friction!r}"/>'
        "</drake:proximity_properties></collision>"
    )


def _geometry(shape: Shape) -> str:
    match shape:
        case Sphere():
            return f'<sphere radius="{shape.radius()!r}"/>'
        case Box():
            size = " ".join(repr(float(x)) for x in shape.size())
            return f'<box size="{size}"/>'
        case Cylinder():
            return f'<cylinder radius="{shape.radius()!r}" length="{shape.length()!r}"/>'
    raise TypeError(f"shape is {shape}, allowed: a sphere, a box or a cylinder")
