// Foxglove's frames, scene updates and point clouds, drawn by three.js as their documentation says.
import * as three from "three";

const seconds = (time) => (time ? Number(time.seconds) + time.nanos / 1e9 : 0);
const vector = ({ x, y, z }) => new three.Vector3(x, y, z);
const place = (object, pose) => {
  object.position.copy(vector(pose.position));
  const { x, y, z, w } = pose.orientation;
  object.quaternion.set(x, y, z, w);
  return object;
};
const material = ({ r, g, b, a }) =>
  new three.MeshLambertMaterial({ color: new three.Color(r, g, b), opacity: a, transparent: a < 1, side: three.DoubleSide });
const sized = (geometry, primitive) => {
  const mesh = new three.Mesh(geometry, material(primitive.color));
  mesh.scale.copy(vector(primitive.size));
  return place(mesh, primitive.pose);
};
const upright = (geometry) => geometry.rotateX(Math.PI / 2); // three's cylinders stand along y, Foxglove's along z

function arrow(primitive) {
  const { shaft_length: shaft, head_length: head } = primitive;
  const along = (radius, tip, length, start) =>
    new three.CylinderGeometry(tip, radius, length, 24).rotateZ(-Math.PI / 2).translate(start + length / 2, 0, 0);
  const group = new three.Group();
  const look = material(primitive.color);
  group.add(new three.Mesh(along(primitive.shaft_diameter / 2, primitive.shaft_diameter / 2, shaft, 0), look));
  group.add(new three.Mesh(along(primitive.head_diameter / 2, 0, head, shaft), look));
  return place(group, primitive.pose);
}

function triangles(primitive) {
  const geometry = new three.BufferGeometry();
  geometry.setAttribute("position", new three.Float32BufferAttribute(primitive.points.flatMap(({ x, y, z }) => [x, y, z]), 3));
  if (primitive.indices.length) geometry.setIndex(primitive.indices);
  geometry.computeVertexNormals();
  return place(new three.Mesh(geometry, material(primitive.color)), primitive.pose);
}

const MAKERS = {
  cubes: (each) => sized(new three.BoxGeometry(1, 1, 1), each),
  spheres: (each) => sized(new three.SphereGeometry(0.5, 32, 16), each),
  cylinders: (each) => sized(upright(new three.CylinderGeometry(each.top_scale / 2, each.bottom_scale / 2, 1, 32)), each),
  arrows: arrow,
  triangles,
};

/** What of a topic of scene updates is there at a time: the last word on each entity, unless it was deleted or lived its life. */
function entitiesAt(updates, time) {
  const living = new Map();
  for (const update of updates.filter(({ at }) => at <= time)) {
    for (const deletion of update.message.deletions) {
      if (deletion.type === "ALL") living.clear();
      else living.delete(deletion.id);
    }
    for (const entity of update.message.entities) living.set(entity.id, { entity, at: update.at });
  }
  const lasts = ({ entity, at }) => !seconds(entity.lifetime) || time < at + seconds(entity.lifetime);
  return [...living.values()].filter(lasts).map(({ entity }) => entity);
}

function points(cloud) {
  const view = new DataView(cloud.data.buffer, cloud.data.byteOffset, cloud.data.byteLength);
  const offsets = Object.fromEntries(cloud.fields.map(({ name, offset }) => [name, offset]));
  const found = [];
  for (let start = 0; start < view.byteLength; start += cloud.point_stride) {
    found.push(...["x", "y", "z"].map((axis) => view.getFloat32(start + offsets[axis], true)));
  }
  const geometry = new three.BufferGeometry();
  geometry.setAttribute("position", new three.Float32BufferAttribute(found, 3));
  return place(new three.Points(geometry, new three.PointsMaterial({ color: 0x202020, size: 1.5, sizeAttenuation: false })), cloud.pose);
}

/** Draw what a file shows at a time; returns how many of each primitive, and the texts. */
export function draw(target, topics, time) {
  const scene = new three.Scene();
  scene.background = new three.Color(0xf4f5f7);
  scene.add(new three.HemisphereLight(0xffffff, 0x777777, 3));
  const frames = new Map([["world", scene]]);
  const tf = topics.get("/tf").filter(({ at }) => at <= time).pop();
  for (const { parent_frame_id: parent, child_frame_id: child, translation, rotation } of tf.message.transforms) {
    const frame = place(new three.Group(), { position: translation, orientation: rotation });
    frames.get(parent).add(frame);
    frames.set(child, frame);
  }
  const counts = { points: 0, texts: [] };
  const box = new three.Box3();
  for (const [topic, messages] of topics) {
    if (messages.schema === "foxglove.SceneUpdate") {
      for (const entity of entitiesAt(messages, time)) {
        for (const [kind, make] of Object.entries(MAKERS)) {
          for (const primitive of entity[kind]) {
            frames.get(entity.frame_id).add(make(primitive));
            counts[kind] = (counts[kind] || 0) + 1;
          }
        }
        counts.texts.push(...entity.texts.map(({ text }) => text));
      }
    } else if (messages.schema === "foxglove.PointCloud") {
      const cloud = messages.filter(({ at }) => at <= time).pop();
      if (!cloud) continue;
      frames.get(cloud.message.frame_id).add(points(cloud.message));
      counts.points += cloud.message.data.length / cloud.message.point_stride;
    }
  }
  scene.updateMatrixWorld(true);
  for (const frame of frames.values()) if (frame !== scene) box.expandByPoint(new three.Vector3().setFromMatrixPosition(frame.matrixWorld));
  render(target, scene, box.getCenter(new three.Vector3()), Math.max(1.2, box.getSize(new three.Vector3()).length() * 0.6));
  return counts;
}

let renderer = null;
let camera = null;

function render(target, scene, centre, radius) {
  if (!renderer) {
    renderer = new three.WebGLRenderer({ antialias: true, preserveDrawingBuffer: true });
    renderer.setSize(target.clientWidth, target.clientHeight);
    target.append(renderer.domElement);
    camera = new three.PerspectiveCamera(40, target.clientWidth / target.clientHeight, 0.01, 1000);
    camera.up.set(0, 0, 1);
    camera.position.copy(centre).add(new three.Vector3(-0.13, -0.55, 0.82).multiplyScalar(radius / Math.sin((20 * Math.PI) / 180)));
    camera.lookAt(centre); // stays where it is, so that pictures of other times can be held against the first
  }
  renderer.render(scene, camera);
}
