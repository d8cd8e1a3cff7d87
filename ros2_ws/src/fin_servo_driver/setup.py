"""Installs the package where ROS 2 looks for it."""

from glob import glob

from setuptools import find_packages, setup

NAME = "fin_servo_driver"

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
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},
    zip_safe=False,
    maintainer="Fin maintainers",
    maintainer_email="maintainers@users.noreply.example",
    description="Drives the tail servos of a real robotic fish safely, as a managed ROS 2 node.",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "calibrate_servo = fin_servo_driver.calibrate_servo:main",
            "operator = fin_servo_driver.operator:main",
            "rehearsal = fin_servo_driver.rehearsal:main",
            "servo_driver = fin_servo_driver.servo_driver:main",
            "velocity_estimator = fin_servo_driver.velocity_estimator:main",
        ],
    },
)
