"""Installs the package where ROS 2 looks for it, or builds the wheel for pip."""

import sys
from glob import glob

from setuptools import find_packages, setup

NAME = "fin_bringup"
EXECUTABLES = [
    "bringup = fin_bringup.bringup:main",
    "bench = fin_bringup.benchmarks.command:main",
    "live = fin_bringup.live:main",
    "lateness = fin_bringup.benchmarks.lateness:main",
    "page = fin_bringup.page.command:main",
]
WHEEL = not {"bdist_wheel", "dist_info", "editable_wheel"}.isdisjoint(sys.argv)

setup(
    name=NAME,
    version="0.1.0",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["*.yaml", "py.typed", "page/static/*", "layouts/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/config", sorted(glob("config/*"))),
        (f"share/{NAME}/layouts", sorted(glob(f"{NAME}/layouts/*"))),
        (f"share/{NAME}/launch", sorted(glob("launch/*.launch.py"))),
    ],
    # ROS is not among them: it is installed, or comes from the wheels in requirements/ros.txt.
    install_requires=[
        "aiohttp",
        "fin_optimizer",
        "fin_plant",
        "fin_servo_driver",
        "fin_sim",
        "foxglove-sdk",
        "numpy",
        "scipy",
    ],
    extras_require={"test": ["pytest"]},
    zip_safe=False,
    maintainer="Fin maintainers",
    maintainer_email="maintainers@users.noreply.example",
    description="Starts a study on a robot, in a rehearsal or in the simulator; launch files, a page, benchmarks.",
    license="Apache-2.0",
    entry_points={
        # colcon puts each into lib/fin_bringup; a wheel has one command, for its bin is everybody's.
        "console_scripts": ["fin-bringup = fin_plant.sub_commands:main"] if WHEEL else EXECUTABLES,
        "fin_executables": EXECUTABLES,
    },
)
