// Connects the live view's WebSocket with the drawing and the panels.

import { connect } from "./connection.js";
import * as panels from "./panels.js";
import { CompressedImage, Log, PointCloud, SceneUpdate, decode } from "./protobuf.js";
import { Scene } from "./scene.js";

const scene = new Scene(document.getElementById("scene"));
const json = (bytes) => JSON.parse(new TextDecoder().decode(bytes));
const draw = (topic) => (bytes) => decode(SceneUpdate, bytes).entities.forEach((entity) => scene.entity(topic, entity));

const takers = {
  "/beo/observation": (bytes) => scene.cloud("/beo/observation", decode(PointCloud, bytes)),
  "/beo/completion": draw("/beo/completion"),
  "/beo/object": draw("/beo/object"),
  "/beo/classes": draw("/beo/classes"),
  "/beo/percept": (bytes) => panels.percept(json(bytes)),
  "/beo/status": (bytes) => panels.status(json(bytes)),
  "/beo/picture": (bytes) => panels.picture(decode(CompressedImage, bytes)),
  "/beo/log": (bytes) => panels.log(decode(Log, bytes)),
};

for (const box of document.querySelectorAll("[data-layer]")) {
  const show = () => scene.show(box.dataset.layer, box.checked);
  box.addEventListener("change", show);
  show();
}
document.getElementById("fit").addEventListener("click", () => {
  scene.isLed = true;
  scene.fit();
});

const { port } = await (await fetch("server.json")).json();
connect(
  `ws://${location.hostname}:${port}`,
  Object.keys(takers),
  (topic, bytes) => takers[topic]?.(bytes),
  (isConnected) => panels.health(isConnected ? "connected" : "no connection", isConnected ? "" : "bad"),
);
