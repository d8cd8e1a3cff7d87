"""Installs the package where ROS 2 looks for it."""

from glob import glob

from setuptools import find_packages, setup

NAME = "fin_sim"

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
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},
    zip_safe=False,
    maintainer="Fin maintainers",
    maintainer_email="maintainers@users.noreply.example",
    description="Simulated robotic fish with a jointed tail and an elastic caudal fin, as a ROS 2 node.",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "materials = fin_sim.materials_command:main",
            "measure_strip = fin_sim.measure_strip:main",
            "simulator = fin_sim.simulator:main",
            "swim = fin_sim.swim_command:main",
            "validation = fin_sim.validation.command:main",
        ],
    },
)
