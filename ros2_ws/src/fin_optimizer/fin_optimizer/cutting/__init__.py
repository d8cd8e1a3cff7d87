"""The fin as a drawing that is cut: outline with clamp and holes, several on a sheet, as DXF, SVG and PDF.

blank   what is cut for one fin: outline, tab, holes, and the line where it begins to swim
sheet   several of them on a sheet
layers  what a drawing consists of, by layer, the same for each writer
dxf     a drawing for laser, plotter and CAM
svg     one for a browser or an editor
pdf     one to print at 1:1 and cut along
"""
