"""Installs the package where ROS 2 looks for it."""

from glob import glob

from setuptools import find_packages, setup

NAME = "fin_bringup"

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
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},
    zip_safe=False,
    maintainer="Fin maintainers",
    maintainer_email="maintainers@users.noreply.example",
    description="Starts a study on a robot, in a rehearsal or in the simulator; launch files, a page, benchmarks.",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "bringup = fin_bringup.bringup:main",
            "bench = fin_bringup.benchmarks.command:main",
            "live = fin_bringup.live:main",
            "lateness = fin_bringup.benchmarks.lateness:main",
            "page = fin_bringup.page.command:main",
        ],
    },
)
