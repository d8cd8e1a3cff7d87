"""The fin as a drawing that is cut: outline with clamp and holes, several on a sheet, as DXF, SVG and PDF."""
