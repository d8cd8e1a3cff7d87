"""Installs the package where ROS 2 looks for it, or builds the wheel for pip."""

import sys
from glob import glob

from setuptools import find_packages, setup

NAME = "fin_optimizer"
EXECUTABLES = [
    "optimizer = fin_optimizer.optimizer:main",
    "bench_search = fin_optimizer.commands.bench_search:main",
    "bringup = fin_optimizer.commands.bringup:main",
    "calibrate = fin_optimizer.commands.calibrate:main",
    "compare_searches = fin_optimizer.commands.compare_searches:main",
    "control = fin_optimizer.commands.control:main",
    "dashboard = fin_optimizer.commands.dashboard:main",
    "export_fin = fin_optimizer.commands.export_fin:main",
    "enrich_bag = fin_optimizer.commands.enrich_bag:main",
    "export = fin_optimizer.commands.export:main",
    "play_bag = fin_optimizer.commands.play_bag:main",
    "recover_study = fin_optimizer.commands.recover_study:main",
    "predict = fin_optimizer.commands.predict:main",
    "repair_bags = fin_optimizer.commands.repair_bags:main",
    "report = fin_optimizer.commands.report:main",
    "score_bag = fin_optimizer.commands.score_bag:main",
    "show_study = fin_optimizer.commands.show_study:main",
    "campaign = fin_optimizer.paper.campaign:main",
]
WHEEL = not {"bdist_wheel", "dist_info", "editable_wheel"}.isdisjoint(sys.argv)

setup(
    name=NAME,
    version="0.1.0",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["*.yaml", "py.typed", "report/*.jinja", "report/*.css", "report/*.js"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/config", sorted(glob("config/*"))),
        (f"share/{NAME}/launch", sorted(glob("launch/*.launch.py"))),
    ],
    # ROS is not among them: it is installed, or comes from the wheels in requirements/ros.txt.
    install_requires=[
        "cmaes",
        "ezdxf",
        "fin_plant",
        "fin_sim",
        "jinja2",
        "matplotlib",
        "mcap",
        "numpy",
        "optuna",
        "optuna-dashboard",
        "plotly",
        "pyarrow",
        "pyyaml",
        "rich",
        "rosbags",
        "scipy",
        "threadpoolctl",
        "zstandard",
    ],
    extras_require={"test": ["pytest"]},
    zip_safe=False,
    maintainer="Fin maintainers",
    maintainer_email="maintainers@users.noreply.example",
    description="Finds the caudal fin that swims fastest: proposes a fin, has a plant swim it, scores it, records it.",
    license="Apache-2.0",
    entry_points={
        # colcon puts each into lib/fin_optimizer; a wheel has one command, for its bin is everybody's.
        "console_scripts": ["fin-optimizer = fin_plant.sub_commands:main"] if WHEEL else EXECUTABLES,
        "fin_executables": EXECUTABLES,
    },
)
