// Two scans laid on each other: as they were matched, and as the final path has them.

import { compose, endsOfRow, rowOfScan } from "report/run";
import { colour } from "report/theme";

const MARGIN = 14;

const moved = ([x, y, heading], ends) => {
  const [c, s] = [Math.cos(heading), Math.sin(heading)];
  const out = new Float32Array(ends.length);
  for (let i = 0; i < ends.length; i += 2) {
    out[i] = x + c * ends[i] - s * ends[i + 1];
    out[i + 1] = y + s * ends[i] + c * ends[i + 1];
  }
  return out;
};

/** Paint scan i and, where it lies in its frame, scan j: [x, y, heading]. Straight ahead of scan i is right or up. */
export function drawPair(canvas, scanI, scanJ, T_i_j) {
  const clouds = [
    { ends: endsOfRow(rowOfScan(scanI)), at: [0, 0, 0], name: "a" },
    { ends: moved(T_i_j, endsOfRow(rowOfScan(scanJ))), at: T_i_j, name: "b" },
  ];
  const [x0, y0, x1, y1] = box(clouds);
  if (y1 - y0 > x1 - x0) {
    const up = [0, 0, Math.PI / 2];
    for (const cloud of clouds) [cloud.ends, cloud.at] = [moved(up, cloud.ends), compose(up, cloud.at)];
  }
  const ratio = Math.min(2, window.devicePixelRatio || 1);
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  [canvas.width, canvas.height] = [width * ratio, height * ratio];
  const context = canvas.getContext("2d");
  context.scale(ratio, ratio);
  const place = fitted(clouds, width, height);
  context.globalAlpha = 0.85;
  for (const { ends, name } of clouds) {
    const size = name === "a" ? 4 : 2.2; // what lies beneath is wider
    context.fillStyle = colour(name);
    for (let i = 0; i < ends.length; i += 2) {
      const [x, y] = place(ends[i], ends[i + 1]);
      context.fillRect(x - size / 2, y - size / 2, size, size);
    }
  }
  context.globalAlpha = 1;
  for (const { at, name } of clouds) arrow(context, ...place(at[0], at[1]), -at[2], colour(name));
}

function box(clouds) {
  let [x0, y0, x1, y1] = [0, 0, 0, 0];
  for (const { ends } of clouds) {
    // What few beams see far away would make all the rest small.
    const [xs, ys] = [0, 1].map((axis) => ends.filter((_, i) => i % 2 === axis).sort());
    const at = (sorted, share) => sorted[Math.round(share * (sorted.length - 1))] ?? 0;
    [x0, y0] = [Math.min(x0, at(xs, 0.01)), Math.min(y0, at(ys, 0.01))];
    [x1, y1] = [Math.max(x1, at(xs, 0.99)), Math.max(y1, at(ys, 0.99))];
  }
  return [x0, y0, x1, y1];
}

function fitted(clouds, width, height) {
  const [x0, y0, x1, y1] = box(clouds);
  const scale = Math.min((width - 2 * MARGIN) / Math.max(x1 - x0, 0.1), (height - 2 * MARGIN) / Math.max(y1 - y0, 0.1));
  return (x, y) => [width / 2 + scale * (x - (x0 + x1) / 2), height / 2 - scale * (y - (y0 + y1) / 2)];
}

function arrow(context, x, y, turn, fill) {
  context.save();
  context.translate(x, y);
  context.rotate(turn);
  context.beginPath();
  context.moveTo(9, 0);
  context.lineTo(-6, 6);
  context.lineTo(-3, 0);
  context.lineTo(-6, -6);
  context.closePath();
  context.fillStyle = fill;
  context.strokeStyle = colour("card");
  context.lineWidth = 1.5;
  context.fill();
  context.stroke();
  context.restore();
}
