"""The fixed model: from a CT label map or a mesh to a surface in millimetres."""
