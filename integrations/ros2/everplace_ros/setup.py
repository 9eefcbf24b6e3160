"""Tells colcon what to install."""

from setuptools import setup

NAME = "everplace_ros"

setup(
    name=NAME,
    version="0.1.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["launch/localize.launch.py"]),
    ],
    install_requires=["setuptools"],
    maintainer="The everplace authors",
    description="Says of every camera image where on an everplace map it was taken, and how sure that is.",
    license="Apache-2.0",
    entry_points={"console_scripts": [f"localize = {NAME}.localize_node:main"]},
)
