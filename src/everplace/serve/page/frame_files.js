// The frames that a user chooses or drops: files and whole folders, in natural order, folder by folder.

import { naturally, stemOf } from "./elements.js";

const IMAGES = /\.(jpe?g|png|webp|bmp|gif|tiff?|p[bgpn]m|heic|heif|avif|jp2)$/i;
const isImage = (file) => file.type.startsWith("image/") || IMAGES.test(file.name);

/**
 * Sorts files into drives.
 *
 * @param found {file, folder} for each.
 * @returns {drives: [{name, frames: [{name, file}]}], others: [names]}: a drive for each folder that holds images, and
 *     what is no image.
 */
export function drivesOf(found) {
  const folders = new Map();
  const others = [];
  for (const { file, folder } of found) {
    if (!isImage(file)) {
      others.push(file.name);
      continue;
    }
    if (!folders.has(folder)) folders.set(folder, []);
    folders.get(folder).push({ name: stemOf(file.name), file });
  }
  const drives = [...folders].map(([name, frames]) => ({
    name, frames: frames.sort((one, other) => naturally(one.file.name, other.file.name)),
  }));
  return { drives: drives.sort((one, other) => naturally(one.name, other.name)), others: others.sort(naturally) };
}

/** Files of an input, each with its folder. */
export const filesOfInput = (input) =>
  [...input.files].map((file) => ({ file, folder: file.webkitRelativePath.split("/").slice(0, -1).join("/") }));

/** Files of a drop, with those in dropped folders. */
export async function filesOfDrop(transfer) {
  // The entries must be taken before the first wait: the browser empties the list then.
  const entries = [...transfer.items].map((item) => item.webkitGetAsEntry?.()).filter(Boolean);
  if (!entries.length) return [...transfer.files].map((file) => ({ file, folder: "" }));
  return (await Promise.all(entries.map((entry) => filesOfEntry(entry, "")))).flat();
}

async function filesOfEntry(entry, folder) {
  if (entry.isFile) return [{ file: await new Promise((resolve, reject) => entry.file(resolve, reject)), folder }];
  const reader = entry.createReader();
  const inside = [];
  for (;;) {
    const some = await new Promise((resolve, reject) => reader.readEntries(resolve, reject));
    if (!some.length) break; // it gives a hundred at a time
    inside.push(...some);
  }
  const path = folder ? `${folder}/${entry.name}` : entry.name;
  return (await Promise.all(inside.map((one) => filesOfEntry(one, path)))).flat();
}

/** What is said of files that are no images. */
export function passedOver(others) {
  if (!others.length) return "";
  const named = others.slice(0, 3).join(", ") + (others.length > 3 ? ", …" : "");
  return others.length === 1 ? `1 file is no image and was left out: ${named}.`
    : `${others.length} files are no images and were left out: ${named}.`;
}
