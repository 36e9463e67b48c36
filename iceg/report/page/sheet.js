// A canvas that lies on the map and moves with it: drawn anew after each move, scaled while the map zooms.

const L = window.L;

const Sheet = L.Renderer.extend({
  initialize(draw, pane) {
    L.Renderer.prototype.initialize.call(this, { pane, padding: 0.2 });
    this._draw = draw;
  },
  _initContainer() {
    this._container = document.createElement("canvas");
    this._container.setAttribute("aria-hidden", "true");
    this._container.style.pointerEvents = "none";
  },
  _destroyContainer() {
    this._container.remove();
  },
  _updatePaths() {},
  _update() {
    if (this._map._animatingZoom && this._bounds) return;
    L.Renderer.prototype._update.call(this);
    const size = this._bounds.getSize();
    const ratio = Math.min(2, window.devicePixelRatio || 1);
    const canvas = this._container;
    L.DomUtil.setPosition(canvas, this._bounds.min);
    [canvas.width, canvas.height] = [Math.round(ratio * size.x), Math.round(ratio * size.y)];
    [canvas.style.width, canvas.style.height] = [`${size.x}px`, `${size.y}px`];
    this._ratio = ratio;
    this.redraw();
  },
  redraw() {
    if (!this._map || !this._bounds) return;
    const context = this._container.getContext("2d");
    const { min } = this._bounds;
    const size = this._bounds.getSize();
    context.setTransform(this._ratio, 0, 0, this._ratio, 0, 0);
    context.clearRect(0, 0, size.x, size.y);
    const zero = this._map.project([0, 0])._subtract(this._map.getPixelOrigin())._subtract(min);
    this._draw(context, new View(this._map.getZoomScale(this._map.getZoom(), 0), zero.x, zero.y, size));
  },
});

/** Where the metres of the map are on a canvas. */
class View {
  constructor(scale, x, y, size) {
    this.scale = scale; // pixels a metre
    [this.left, this.top] = [x, y];
    [this.width, this.height] = [size.x, size.y];
  }
  x(metres) {
    return this.left + this.scale * metres;
  }
  y(metres) {
    return this.top - this.scale * metres;
  }
  holds(x, y, margin = 20) {
    return x > -margin && y > -margin && x < this.width + margin && y < this.height + margin;
  }
  /** [x_min, y_min, x_max, y_max] of the canvas in metres. */
  box() {
    const x = (pixels) => (pixels - this.left) / this.scale;
    const y = (pixels) => (this.top - pixels) / this.scale;
    return [x(0), y(this.height), x(this.width), y(0)];
  }
}

/** Put a canvas on the map; `draw(context, view)` paints it. It is redrawn once a frame at most, see `touch`. */
export function addSheet(map, draw, order) {
  const pane = `sheet-${order}`;
  map.createPane(pane).style.zIndex = 400 + order;
  const sheet = new Sheet(draw, pane).addTo(map);
  let waiting = false;
  sheet.touch = () => {
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(() => {
      waiting = false;
      sheet.redraw();
    });
  };
  return sheet;
}
