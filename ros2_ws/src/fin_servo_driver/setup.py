"""Installs the package where ROS 2 looks for it, or builds the wheel for pip."""

import sys
from glob import glob

from setuptools import find_packages, setup

NAME = "fin_servo_driver"
EXECUTABLES = [
    "calibrate_servo = fin_servo_driver.calibrate_servo:main",
    "operator = fin_servo_driver.operator:main",
    "rehearsal = fin_servo_driver.rehearsal:main",
    "servo_driver = fin_servo_driver.servo_driver:main",
    "velocity_estimator = fin_servo_driver.velocity_estimator:main",
]
WHEEL = not {"bdist_wheel", "dist_info", "editable_wheel"}.isdisjoint(sys.argv)

setup(
    name=NAME,
    version="0.1.0",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["*.yaml", "py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/config", sorted(glob("config/*"))),
        (f"share/{NAME}/launch", sorted(glob("launch/*.launch.py"))),
    ],
    # ROS is not among them: it is installed, or comes from the wheels in requirements/ros.txt.
    install_requires=[
        "dynamixel-sdk",
        "fin_plant",
        "fin_sim",
        "numpy",
        "pyserial",
        "pyyaml",
        "rich",
    ],
    extras_require={"test": ["pytest"]},
    zip_safe=False,
    maintainer="Fin maintainers",
    maintainer_email="maintainers@users.noreply.example",
    description="Drives the tail servos of a real robotic fish safely, as a managed ROS 2 node.",
    license="Apache-2.0",
    entry_points={
        # colcon puts each into lib/fin_servo_driver; a wheel has one command, for its bin is everybody's.
        "console_scripts": ["fin-servo-driver = fin_plant.sub_commands:main"] if WHEEL else EXECUTABLES,
        "fin_executables": EXECUTABLES,
    },
)
