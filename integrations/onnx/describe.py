"""Describes images with a network of `everplace export`, and finds them on a map, without torch and everplace.

pip install onnxruntime numpy pillow opencv-python-headless lancedb
python describe.py adapted.onnx IMAGE...          a line of JSON an image: its descriptor
python describe.py map.onnx IMAGE... --map MAP    its best frame on the map that the network was exported from
"""

import argparse
import json

import cv2
import numpy as np
import onnxruntime
from PIL import Image, ImageOps

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("network")
parser.add_argument("images", nargs="+")
parser.add_argument("--map")
given = parser.parse_args()

session = onnxruntime.InferenceSession(given.network)
told = session.get_modelmeta().custom_metadata_map
height, width = map(int, told["everplace.image_size"].split())
mode, channels = ("L", 1) if told["everplace.colour"] == "grey" else ("RGB", 3)
if given.map:
    import lancedb

    database = lancedb.connect(given.map)
    version = json.loads(told["everplace.about"]).get("map_version", 0)
    states = database.open_table("states").search().where(f"version = {version}").to_list()
    if not states:
        parser.error(f"{given.network} was not exported from a version of {given.map}; export the map again")
    state = states[0]
    drives = [drive["name"] for drive in json.loads(state["document"])["drives"]]
    tables = {name: database.open_table(name) for name in ("frames", "descriptors")}
    for name, table in tables.items():
        table.checkout(state[f"{name}_version"])
    frames = tables["frames"].search().select(["drive", "number", "stem", "place"]).limit(None).to_list()
    frames.sort(key=lambda frame: (drives.index(frame["drive"]), frame["number"]))
    rows = sorted(tables["descriptors"].search().limit(None).to_list(), key=lambda row: row["row"])
    known = np.array([row["descriptor"] for row in rows])
    known /= np.maximum(np.linalg.norm(known, axis=1, keepdims=True), 1e-12)
for path in given.images:
    picture = ImageOps.exif_transpose(Image.open(path))
    if picture.mode.startswith(("I", "F")):
        parser.error(f"{path} has more than 8 bits a pixel; convert it to 8 bits")
    pixels = np.array(picture.convert(mode))
    smaller = (min(width, pixels.shape[1]), min(height, pixels.shape[0]))
    pixels = cv2.resize(cv2.resize(pixels, smaller, interpolation=cv2.INTER_AREA), (width, height))
    image = pixels.reshape(1, height, width, channels).transpose(0, 3, 1, 2).astype(np.float32) / 255
    descriptor = session.run(None, {"images": image})[0][0]
    if given.map:
        cosines = known @ (descriptor / np.linalg.norm(descriptor))
        found = frames[int(cosines.argmax())]
        answer = {key: found[key] for key in ("drive", "stem", "place")} | {"cosine": round(float(cosines.max()), 4)}
    else:
        answer = {"descriptor": descriptor.tolist()}
    print(json.dumps({"image": path, **answer}))
