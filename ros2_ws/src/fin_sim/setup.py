"""Installs the package where ROS 2 looks for it, or builds the wheel for pip."""

import sys
from glob import glob

from setuptools import find_packages, setup

NAME = "fin_sim"
EXECUTABLES = [
    "materials = fin_sim.materials_command:main",
    "measure_strip = fin_sim.measure_strip:main",
    "simulator = fin_sim.simulator:main",
    "swim = fin_sim.swim_command.command:main",
    "validation = fin_sim.validation.command:main",
]
WHEEL = not {"bdist_wheel", "dist_info", "editable_wheel"}.isdisjoint(sys.argv)

setup(
    name=NAME,
    version="0.1.0",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["*.yaml", "py.typed", "data/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/config", sorted(glob("config/*"))),
        (f"share/{NAME}/launch", sorted(glob("launch/*.launch.py"))),
    ],
    # ROS is not among them: it is installed, or comes from the wheels in requirements/ros.txt.
    install_requires=[
        "fin_plant",
        "matplotlib",
        "numba",
        "numpy",
        "rich",
        "scipy",
        "threadpoolctl",
    ],
    extras_require={"test": ["pytest"]},
    zip_safe=False,
    maintainer="Fin maintainers",
    maintainer_email="maintainers@users.noreply.example",
    description="Simulated robotic fish with a jointed tail and an elastic caudal fin, as a ROS 2 node.",
    license="Apache-2.0",
    entry_points={
        # colcon puts each into lib/fin_sim; a wheel has one command, for its bin is everybody's.
        "console_scripts": ["fin-sim = fin_plant.sub_commands:main"] if WHEEL else EXECUTABLES,
        "fin_executables": EXECUTABLES,
    },
)
