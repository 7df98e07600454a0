// The land as a layer of the map: tiles of rings from the server, drawn in the page's own colours.

const TILE = 512;
const STEPS = 4;
// Tiles asked for at a time: the server makes one after the other, and a browser has six connections.
const AT_A_TIME = 2;

// Time after which a tile of the coarse coast is asked for again, milliseconds.
const AGAIN_MS = 3000;

const waiting = [];
let asked = 0;

/** Ask for the tiles that wait, the latest first; none that is off the map by now. */
async function askNext() {
  if (asked >= AT_A_TIME || !waiting.length) return;
  const { tile, path, done } = waiting.pop();
  if (tile.isConnected) {
    asked += 1;
    try {
      const answer = await fetch(path);
      const { rings, is_sharp: isSharp } = answer.ok ? await answer.json() : { rings: [], is_sharp: true };
      tile.rings = rings;
      draw(tile, rings);
      done(null, tile);
      if (!isSharp) setTimeout(() => { waiting.push({ tile, path, done: () => {} }); askNext(); }, AGAIN_MS);
      document.getElementById("coast").textContent = isSharp ? "" : "The sharp coast is being prepared; it takes half a minute, once.";
    } catch (error) {
      done(error, tile);
    }
    asked -= 1;
  }
  askNext();
}

const colour = (role) => getComputedStyle(document.documentElement).getPropertyValue(`--map-${role}`).trim();

/** Draw rings on a tile. */
function draw(tile, rings) {
  const context = tile.getContext("2d");
  context.setTransform(1, 0, 0, 1, 0, 0);
  context.clearRect(0, 0, tile.width, tile.height);
  const ratio = tile.width / TILE;
  context.setTransform(ratio / STEPS, 0, 0, ratio / STEPS, 0, 0);
  context.beginPath();
  for (const ring of rings) {
    context.moveTo(ring[0], ring[1]);
    for (let i = 2; i < ring.length; i += 2) context.lineTo(ring[i], ring[i + 1]);
    context.closePath();
  }
  context.fillStyle = colour("land");
  context.fill("evenodd");
  context.strokeStyle = colour("coast");
  context.lineWidth = STEPS * 0.8;
  context.stroke();
}

/** The layer; it is drawn again where the reader changes between light and dark. */
export function landLayer() {
  const Land = L.GridLayer.extend({
    createTile(coords, done) {
      const tile = document.createElement("canvas");
      tile.width = tile.height = TILE * Math.min(2, devicePixelRatio || 1);
      tile.setAttribute("aria-hidden", "true");
      // Tiles are twice as wide as those that the zoom counts.
      waiting.push({ tile, path: `/api/land/${coords.z - 1}/${coords.x}/${coords.y}`, done });
      setTimeout(askNext);
      return tile;
    },
  });
  const layer = new Land({ tileSize: TILE, minZoom: 1, maxZoom: 15, updateWhenZooming: false, keepBuffer: 1 });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
    for (const tile of layer.getContainer().querySelectorAll("canvas")) if (tile.rings) draw(tile, tile.rings);
  });
  return layer;
}
