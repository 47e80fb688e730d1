// The drawing: entities and point clouds as they come, and away again when their time is over.

import * as THREE from "three";
import { OrbitControls } from "./three/OrbitControls.js";

/** Points stay so long: the next view of the object brings others. */
const CLOUD_MS = 1000;
const TEXT_PX = 48;

const number3 = (v) => new THREE.Vector3(v?.x ?? 0, v?.y ?? 0, v?.z ?? 0);
const colour = (c) => new THREE.Color().setRGB(c?.r ?? 1, c?.g ?? 1, c?.b ?? 1, THREE.SRGBColorSpace);

function place(object, pose) {
  object.position.copy(number3(pose?.position));
  const q = pose?.orientation;
  if (q) object.quaternion.set(q.x, q.y, q.z, q.w).normalize();
  return object;
}

function material(kind, color, more) {
  const opacity = color?.a ?? 1;
  return new kind({ color: colour(color), transparent: opacity < 1, opacity, ...more });
}

function surface({ pose, points, colors, indices }) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.Float32BufferAttribute(points.flatMap(({ x, y, z }) => [x, y, z]), 3));
  const linear = new THREE.Color();
  const rgba = colors.flatMap((c) => [...linear.setRGB(c.r, c.g, c.b, THREE.SRGBColorSpace), c.a]);
  geometry.setAttribute("color", new THREE.Float32BufferAttribute(rgba, 4));
  geometry.setIndex(indices);
  geometry.computeVertexNormals();
  // Far sides are drawn first, so that near ones lie over them.
  const group = new THREE.Group();
  for (const side of [THREE.BackSide, THREE.FrontSide]) {
    group.add(new THREE.Mesh(geometry, new THREE.MeshStandardMaterial({ vertexColors: true, transparent: true, side, roughness: 0.8 })));
  }
  return place(group, pose);
}

/** Points along +x of its pose. */
function arrow({ pose, shaftLength, shaftDiameter, headLength, headDiameter, color }) {
  const group = new THREE.Group();
  const shade = material(THREE.MeshStandardMaterial, color, { roughness: 0.6 });
  const shaft = new THREE.Mesh(new THREE.CylinderGeometry(shaftDiameter / 2, shaftDiameter / 2, shaftLength, 16), shade);
  const head = new THREE.Mesh(new THREE.ConeGeometry(headDiameter / 2, headLength, 20), shade);
  shaft.rotation.z = head.rotation.z = -Math.PI / 2;
  shaft.position.x = shaftLength / 2;
  head.position.x = shaftLength + headLength / 2;
  group.add(shaft, head);
  return place(group, pose);
}

function cube({ pose, size, color }) {
  return place(new THREE.Mesh(new THREE.BoxGeometry(size?.x ?? 0, size?.y ?? 0, size?.z ?? 0), material(THREE.MeshStandardMaterial, color)), pose);
}

function line({ type, pose, points, color }) {
  const geometry = new THREE.BufferGeometry().setFromPoints(points.map(number3));
  const kind = [THREE.Line, THREE.LineLoop, THREE.LineSegments][type] ?? THREE.Line;
  return place(new kind(geometry, material(THREE.LineBasicMaterial, color)), pose);
}

/** Text of a height in pixels that faces the viewer, whatever is before it. */
function label({ pose, size, color, text }) {
  const canvas = document.createElement("canvas");
  const context = canvas.getContext("2d");
  const font = `${TEXT_PX}px system-ui, sans-serif`;
  context.font = font;
  canvas.width = Math.ceil(context.measureText(text).width) + 8;
  canvas.height = 1.3 * TEXT_PX;
  context.font = font;
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.lineWidth = 6;
  context.strokeStyle = "#14171c";
  context.strokeText(text, canvas.width / 2, canvas.height / 2);
  context.fillStyle = `#${colour(color).getHexString()}`;
  context.fillText(text, canvas.width / 2, canvas.height / 2);
  const map = new THREE.CanvasTexture(canvas);
  map.colorSpace = THREE.SRGBColorSpace;
  const sprite = new THREE.Sprite(new THREE.SpriteMaterial({ map, depthTest: false, sizeAttenuation: false }));
  sprite.userData.pixels = [(canvas.width * size) / TEXT_PX, (canvas.height * size) / TEXT_PX];
  sprite.renderOrder = 1;
  return place(sprite, pose);
}

function points({ pose, stride, fields, data }, pixels) {
  const at = Object.fromEntries(fields.map(({ name, offset }) => [name, offset]));
  const count = stride ? Math.floor(data.length / stride) : 0;
  const view = new DataView(data.buffer, data.byteOffset, data.byteLength);
  const [places, colours] = [new Float32Array(3 * count), new Float32Array(3 * count)];
  const linear = new THREE.Color();
  for (let n = 0; n < count; n++) {
    const start = n * stride;
    ["x", "y", "z"].forEach((axis, i) => (places[3 * n + i] = view.getFloat32(start + at[axis], true)));
    const [r, g, b] = ["red", "green", "blue"].map((channel) => view.getUint8(start + at[channel]) / 255);
    linear.setRGB(r, g, b, THREE.SRGBColorSpace).toArray(colours, 3 * n);
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(places, 3));
  geometry.setAttribute("color", new THREE.BufferAttribute(colours, 3));
  return place(new THREE.Points(geometry, new THREE.PointsMaterial({ size: pixels, sizeAttenuation: false, vertexColors: true })), pose);
}

function dispose(object) {
  object.traverse((part) => {
    part.geometry?.dispose();
    part.material?.map?.dispose();
    part.material?.dispose();
  });
}

export class Scene {
  constructor(parent) {
    this.renderer = new THREE.WebGLRenderer({ antialias: true });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    parent.append(this.renderer.domElement);
    this.scene = new THREE.Scene();
    this.scene.background = new THREE.Color("#14171c");
    this.camera = new THREE.PerspectiveCamera(45, 1, 0.005, 100);
    this.camera.up.set(0, 0, 1);
    this.light = new THREE.DirectionalLight("#ffffff", 2);
    this.scene.add(new THREE.HemisphereLight("#ffffff", "#606060", 1.6), this.light, new THREE.AxesHelper(0.1));
    this.controls = new OrbitControls(this.camera, this.renderer.domElement);
    this.isLed = true;
    this.controls.addEventListener("start", () => (this.isLed = false));
    this.layers = new Map();
    this.drawn = new Map();
    this.clouds = 0;
    new ResizeObserver(() => this.resize(parent)).observe(parent);
    this.resize(parent);
    this.renderer.setAnimationLoop(() => this.draw());
  }

  resize({ clientWidth: width, clientHeight: height }) {
    this.renderer.setSize(width, height);
    this.camera.aspect = width / Math.max(height, 1);
    this.camera.updateProjectionMatrix();
    this.height = height;
  }

  layer(topic) {
    if (!this.layers.has(topic)) {
      this.layers.set(topic, new THREE.Group());
      this.scene.add(this.layers.get(topic));
    }
    return this.layers.get(topic);
  }

  show(topic, isShown) {
    this.layer(topic).visible = isShown;
  }

  put(topic, id, object, lifetimeMs) {
    const key = `${topic} ${id}`;
    this.remove(key);
    this.layer(topic).add(object);
    this.drawn.set(key, { object, until: lifetimeMs > 0 ? performance.now() + lifetimeMs : Infinity });
  }

  remove(key) {
    const { object } = this.drawn.get(key) ?? {};
    if (!object) return;
    object.removeFromParent();
    dispose(object);
    this.drawn.delete(key);
  }

  entity(topic, entity) {
    const group = new THREE.Group();
    const parts = [entity.triangles.map(surface), entity.arrows.map(arrow), entity.cubes.map(cube), entity.lines.map(line), entity.texts.map(label)];
    group.add(...parts.flat());
    const { seconds = 0, nanos = 0 } = entity.lifetime ?? {};
    this.put(topic, entity.id, group, 1000 * seconds + nanos / 1e6);
    if (this.isLed) this.fit();
  }

  cloud(topic, cloud) {
    // The grid's z axis is up.
    const up = new THREE.Vector3(0, 0, 1);
    const q = cloud.pose?.orientation;
    if (q) up.applyQuaternion(new THREE.Quaternion(q.x, q.y, q.z, q.w).normalize());
    if (this.isLed && up.angleTo(this.camera.up) > 0.05) this.stand(up, q);
    this.put(topic, this.clouds++, points(cloud, 4), CLOUD_MS);
  }

  /** Lets `up` be up, and looks from before the grid, whose x axis leads away from the camera that saw it. */
  stand(up, q) {
    this.camera.up.copy(up);
    this.ahead = q && new THREE.Vector3(1, 0, 0).applyQuaternion(new THREE.Quaternion(q.x, q.y, q.z, q.w).normalize());
    this.controls.dispose();
    this.controls = new OrbitControls(this.camera, this.renderer.domElement);
    this.controls.addEventListener("start", () => (this.isLed = false));
  }

  /** Looks at everything. */
  fit() {
    this.scene.updateMatrixWorld();
    const box = new THREE.Box3();
    // Texts have a size on the screen, and none in the scene.
    const extend = (part) => (part.isMesh || part.isLine || part.isPoints) && box.expandByObject(part);
    for (const layer of this.layers.values()) if (layer.visible) layer.traverse(extend);
    if (box.isEmpty()) return;
    const { center, radius } = box.getBoundingSphere(new THREE.Sphere());
    const { up } = this.camera;
    let away = this.ahead?.clone().negate() ?? new THREE.Vector3(-1, -0.4, 0).projectOnPlane(up);
    if (away.lengthSq() < 1e-6) away = new THREE.Vector3(1, 0, 0).projectOnPlane(up);
    away.normalize().addScaledVector(up, 0.55).addScaledVector(new THREE.Vector3().crossVectors(up, away), 0.35).normalize();
    this.controls.target.copy(center);
    const half = THREE.MathUtils.degToRad(this.camera.fov / 2) * Math.min(1, this.camera.aspect);
    this.camera.position.copy(center).addScaledVector(away, (0.8 * Math.max(radius, 0.05)) / Math.sin(half));
    this.controls.update();
  }

  draw() {
    const now = performance.now();
    for (const [key, { until }] of this.drawn) if (until < now) this.remove(key);
    this.controls.update();
    this.light.position.copy(this.camera.position).addScaledVector(this.camera.up, 1);
    // The height of the picture at a distance of one, in metres: what texts' heights in pixels are of.
    const perPixel = (2 * Math.tan(THREE.MathUtils.degToRad(this.camera.fov / 2))) / Math.max(this.height, 1);
    this.scene.traverse(({ isSprite, scale, userData }) => isSprite && scale.set(userData.pixels[0] * perPixel, userData.pixels[1] * perPixel, 1));
    this.renderer.render(this.scene, this.camera);
  }
}
