// The occupancy grid as a picture in the colours of the theme.

import { on } from "report/bus";
import { run } from "report/run";
import { rgb } from "report/theme";

const { rows, columns, shades } = run.grid;

export const picture = Object.assign(document.createElement("canvas"), { width: columns, height: rows });

function paint() {
  const context = picture.getContext("2d");
  const image = context.createImageData(columns, rows);
  const pixels = new Uint32Array(image.data.buffer);
  const palette = colours();
  for (let row = 0; row < rows; row++) {
    const to = (rows - 1 - row) * columns; // an image begins at the top, the grid at the bottom
    for (let column = 0; column < columns; column++) {
      const cell = row * columns + column;
      pixels[to + column] = palette[(shades[cell >> 1] >> (4 * (cell & 1))) & 15];
    }
  }
  context.putImageData(image, 0, 0);
}

function colours() {
  const [free, wall] = [rgb("map-free"), rgb("map-wall")];
  const palette = new Uint32Array(16);
  const bytes = new Uint8Array(palette.buffer);
  for (let shade = 1; shade < 16; shade++) {
    // Free cells have one colour, however often they were seen; walls darken with what speaks for them.
    const share = Math.max(0, (shade - 8) / 7);
    for (let i = 0; i < 3; i++) bytes[4 * shade + i] = free[i] + share * (wall[i] - free[i]);
    bytes[4 * shade + 3] = shade === 8 ? 150 : 255;
  }
  return palette;
}

paint();
on("theme", paint);

/** Draw the picture, or another canvas over the same box, where the grid lies. */
export function drawGrid(context, view, image = picture) {
  const { origin, resolution } = run.grid;
  context.imageSmoothingEnabled = view.scale * resolution < 1;
  context.imageSmoothingQuality = "high";
  const [width, height] = [columns * resolution, rows * resolution];
  context.drawImage(image, view.x(origin[0]), view.y(origin[1] + height), view.scale * width, view.scale * height);
}
