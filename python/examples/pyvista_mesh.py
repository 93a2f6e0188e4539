"""An unstructured grid of PyVista's, rendered as it is, and the camera of its plotter."""

import pyvista as pv
from _arguments import FIXTURES, arguments

import ewa_splat as es

size, out = arguments(__doc__)
grid = pv.read(FIXTURES / "solids.vtkhdf").triangulate()
grid["height"] = grid.points[:, 2]

plotter = pv.Plotter(off_screen=True)
plotter.camera_position = [(5.0, -4.0, 2.5), (1.5, 0.5, 0.5), (0.0, 0.0, 1.0)]
camera = es.Camera.from_pyvista(plotter.camera)

renderer = es.Renderer(es.adapt(grid, "height"))
renderer.render(camera, size, transfer_function="plasma", legend=size[0] > 300).save(out / "pyvista.png")
print(renderer)
