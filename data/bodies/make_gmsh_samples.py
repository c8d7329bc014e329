"""Writes the small Gmsh samples beside this file, in every version and coding that Dermis reads.

pip install gmsh; python make_gmsh_samples.py. Made with Gmsh 4.15.2. The files are geometry alone: ours.
"""

import gmsh


def save(name):
    gmsh.option.setNumber("Mesh.RandomFactor", 1e-9)
    for version in (2.2, 4.1):
        for binary in (0, 1):
            gmsh.option.setNumber("Mesh.MshFileVersion", version)
            gmsh.option.setNumber("Mesh.Binary", binary)
            gmsh.write(f"{name}_{version}_{'binary' if binary else 'ascii'}.msh")


def block():
    """40 x 20 x 10 mm, in mm: electrodes 0 and 1 on the ends x = 0 and 40, 2 and 3 points at their corners; one region."""
    gmsh.model.add("block")
    gmsh.model.occ.addBox(0, 0, 0, 40, 20, 10)
    gmsh.model.occ.synchronize()
    for electrode, x in enumerate((0, 40)):
        face = gmsh.model.occ.getEntitiesInBoundingBox(x - 1, -1, -1, x + 1, 21, 11, 2)
        gmsh.model.addPhysicalGroup(2, [tag for _, tag in face], name=f"electrode_{electrode}")
    for electrode, x in ((2, 0), (3, 40)):
        corner = gmsh.model.occ.getEntitiesInBoundingBox(x - 1, -1, -1, x + 1, 1, 1, 0)
        gmsh.model.addPhysicalGroup(0, [tag for _, tag in corner], name=f"electrode_{electrode}")
    gmsh.model.addPhysicalGroup(3, [1], name="gel")
    gmsh.option.setNumber("Mesh.MeshSizeMax", 12)
    gmsh.model.mesh.generate(3)
    save("block")


def sheet():
    """40 x 20 mm, in mm: electrodes 0 and 1 the edges x = 0 and 40, 2 a disc of radius 3 at (20, 10), 3 a point at (40, 20).

    The region "sheet" is everything, "core" the disc of the electrode and "left" what lies left of x = 10.
    """
    gmsh.model.add("sheet")
    occ = gmsh.model.occ
    parts = [(2, occ.addRectangle(0, 0, 0, 10, 20)), (2, occ.addRectangle(10, 0, 0, 30, 20))]
    occ.fragment(parts, [(2, occ.addDisk(20, 10, 0, 3, 3))])
    occ.synchronize()
    for electrode, x in enumerate((0, 40)):
        edge = occ.getEntitiesInBoundingBox(x - 1, -1, -1, x + 1, 21, 1, 1)
        gmsh.model.addPhysicalGroup(1, [tag for _, tag in edge], name=f"electrode_{electrode}")
    disc = [tag for _, tag in occ.getEntitiesInBoundingBox(16, 6, -1, 24, 14, 1, 2)]
    left = [tag for _, tag in occ.getEntitiesInBoundingBox(-1, -1, -1, 11, 21, 1, 2)]
    everything = [tag for _, tag in occ.getEntities(2)]
    gmsh.model.addPhysicalGroup(2, disc, name="electrode_2")
    corner = occ.getEntitiesInBoundingBox(39, 19, -1, 41, 21, 1, 0)
    gmsh.model.addPhysicalGroup(0, [tag for _, tag in corner], name="electrode_3")
    gmsh.model.addPhysicalGroup(2, everything, name="sheet")
    gmsh.model.addPhysicalGroup(2, disc, name="core")
    gmsh.model.addPhysicalGroup(2, left, name="left")
    gmsh.option.setNumber("Mesh.MeshSizeMax", 4)
    gmsh.model.mesh.generate(2)
    save("sheet")


gmsh.initialize()
gmsh.option.setNumber("General.Verbosity", 1)
block()
sheet()
gmsh.finalize()
