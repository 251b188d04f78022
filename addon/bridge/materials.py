"""Materials that show photos on the scan, and the one place where pixels become UVs.

One material per photo, made once and used again; its image is the original file. A photo carries the light of
its day, so the material shows it as it is, without lamps (glTF: unlit).
"""

from __future__ import annotations

import bpy
import numpy as np

from ...core.arrays import FloatArray

UV_MAP = "Fresco"
UNSEEN_NAME = "Fresco unseen"
UNSEEN_COLOR = (0.36, 0.36, 0.36, 1.0)
GAIN_NODE = "Fresco gain"


def uvs_from_pixels(pixels: FloatArray, width: int, height: int) -> FloatArray:
    """Blender's UVs of pixels (...,2) in a photo of width x height.

    Core's (0, 0) is the centre of the top-left pixel; Blender's is the corner of the bottom-left one.
    """
    uvs = np.empty_like(pixels)
    uvs[..., 0] = (pixels[..., 0] + 0.5) / width
    uvs[..., 1] = 1.0 - (pixels[..., 1] + 0.5) / height
    return uvs


def pixels_from_uvs(uvs: FloatArray, width: int, height: int) -> FloatArray:
    """Core's pixels of Blender's UVs (...,2): the inverse of `uvs_from_pixels`."""
    pixels = np.empty_like(uvs)
    pixels[..., 0] = uvs[..., 0] * width - 0.5
    pixels[..., 1] = (1.0 - uvs[..., 1]) * height - 0.5
    return pixels


def photo_material(
    name: str, image: bpy.types.Image, existing: bpy.types.Material | None, uv_name: str = UV_MAP
) -> bpy.types.Material:
    """Return the material that shows a photo: the existing one with its image put right, or a new one."""
    if existing is not None:
        nodes = {node.type: node for node in existing.node_tree.nodes}
        if "TEX_IMAGE" in nodes and "UVMAP" in nodes:
            nodes["TEX_IMAGE"].image, nodes["UVMAP"].uv_map = image, uv_name
            return existing
    material = _empty_material(name)
    nodes, links = material.node_tree.nodes, material.node_tree.links
    output = nodes.new("ShaderNodeOutputMaterial")
    output.location = (200, 0)
    texture = nodes.new("ShaderNodeTexImage")
    texture.image = image
    texture.extension = "EXTEND"  # no wrapping at the frame's edge
    texture.location = (-500, 0)
    uv_map = nodes.new("ShaderNodeUVMap")
    uv_map.uv_map = uv_name
    uv_map.location = (-720, -160)
    gain = nodes.new("ShaderNodeMix")
    gain.name = gain.label = GAIN_NODE
    gain.data_type, gain.blend_type, gain.location = "RGBA", "MULTIPLY", (-120, 0)
    gain.inputs["Factor"].default_value = 1.0
    _color_input(gain, "B").default_value = (1.0, 1.0, 1.0, 1.0)
    links.new(uv_map.outputs["UV"], texture.inputs["Vector"])
    links.new(texture.outputs["Color"], _color_input(gain, "A"))
    links.new(next(o for o in gain.outputs if o.type == "RGBA"), output.inputs["Surface"])
    nodes.active = texture  # what the viewport's texture mode shows
    return material


def _color_input(mix: bpy.types.Node, name: str) -> bpy.types.NodeSocket:
    """Colour socket of a Mix node, which has sockets of the same name for every type."""
    return next(socket for socket in mix.inputs if socket.name == name and socket.type == "RGBA")


def write_gain(material: bpy.types.Material, gain: FloatArray) -> None:
    """Set the linear factors (3,) that make a photo agree with the others."""
    node = material.node_tree.nodes.get(GAIN_NODE)
    if node is not None:
        _color_input(node, "B").default_value = (*(float(factor) for factor in gain), 1.0)


def write_repeating(material: bpy.types.Material, repeats: bool) -> None:
    """Let a photo's picture go on at its other side beyond the frame, or end there."""
    for node in material.node_tree.nodes:
        if node.type == "TEX_IMAGE":
            node.extension = "REPEAT" if repeats else "EXTEND"


def unseen_material() -> bpy.types.Material:
    """Return the neutral material of faces that no photo sees; it shines like the photos' own."""
    existing = bpy.data.materials.get(UNSEEN_NAME)
    if existing is not None:
        return existing
    material = _empty_material(UNSEEN_NAME)
    material.diffuse_color = UNSEEN_COLOR
    nodes = material.node_tree.nodes
    output = nodes.new("ShaderNodeOutputMaterial")
    output.location = (200, 0)
    color = nodes.new("ShaderNodeRGB")
    color.outputs["Color"].default_value = UNSEEN_COLOR
    color.location = (-120, 0)
    material.node_tree.links.new(color.outputs["Color"], output.inputs["Surface"])
    return material


def _empty_material(name: str) -> bpy.types.Material:
    material = bpy.data.materials.new(name)
    if material.node_tree is None:  # from Blender 5.0 on every material has nodes
        material.use_nodes = True
    material.node_tree.nodes.clear()
    return material
