"""Installs the package where ROS 2 looks for it, or builds the wheel for pip."""

from glob import glob

from setuptools import find_packages, setup

NAME = "fin_plant"

setup(
    name=NAME,
    version="0.1.0",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["*.yaml", "*.xml", "py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/config", sorted(glob("config/*"))),
        (f"share/{NAME}/launch", sorted(glob("launch/*.launch.py"))),
    ],
    # ROS is not among them: it is installed, or comes from the wheels in requirements/ros.txt.
    install_requires=[
        "matplotlib",
        "numpy",
        "pyyaml",
        "threadpoolctl",
    ],
    extras_require={"test": ["pytest"]},
    zip_safe=False,
    maintainer="Fin maintainers",
    maintainer_email="maintainers@users.noreply.example",
    description="What a simulated and a real robotic fish have in common: fin, gait, parameters, topics, messages.",
    license="Apache-2.0",
)
