// SPDX-License-Identifier: Apache-2.0
// The three-dimensional view, in {B}, metres, z up: bone, tool, bending sheet, holes, force. Three cameras; the resolution follows
// the frame rate, so that it also works where there is no GPU.
import * as THREE from "three";
import { OrbitControls } from "orbit";
import { make_goals } from "./goals3d.js";
import { colours_of, draw_legend, range_of } from "./hu.js";

const kNearSlices = 3;            // on each side of the tip
const kStub = 0.1;  // of the shaft, where the camera looks along it
const kToolLength_m = 0.12, kArrow_m_per_N = 0.0008, kLeastArrow_N = 0.3;
const kLeastScale = 0.5, kRest_ms = 400, kSlowFrame_ms = 30, kFastFrame_ms = 19;
const kCoarseTriangles = 10000;  // about so many of the surface are drawn where the resolution is reduced

THREE.ColorManagement.enabled = false;  // colours of the HU map go to the screen as they are

const sheet_material = (opacity) =>
  new THREE.MeshBasicMaterial({ vertexColors: true, transparent: true, opacity, depthWrite: false, side: THREE.DoubleSide, forceSinglePass: true });

/// The boundary edges of a mesh: the slice's contour, and its holes.
function boundary_of(triangles, vertices) {
  const seen = new Map();
  for (let k = 0; k < triangles.length; k += 3)
    for (let e = 0; e < 3; ++e) {
      const a = triangles[k + e], b = triangles[k + ((e + 1) % 3)];
      const back = b * vertices + a;
      if (seen.has(back)) seen.delete(back);
      else seen.set(a * vertices + b, [a, b]);
    }
  return new Uint32Array([...seen.values()].flat());
}

/// A mesh of about kCoarseTriangles for pictures of a reduced resolution: the vertices in each cell of a grid become their middle
/// (vertex clustering, Rossignac and Borrel 1993).
function coarse_of(geometry) {
  const triangles = geometry.index.array, xyz = geometry.getAttribute("position"), triangle = new THREE.Triangle();
  let area = 0;
  for (let k = 0; k < triangles.length; k += 3)
    area += triangle.setFromAttributeAndIndices(xyz, triangles[k], triangles[k + 1], triangles[k + 2]).getArea();
  const cell = Math.sqrt((2 * area) / kCoarseTriangles), of_cell = (value) => Math.floor(value / cell);
  const firsts = new Map(), first = new Uint32Array(xyz.count), counts = new Uint32Array(xyz.count), middles = new Float32Array(3 * xyz.count);
  for (let i = 0; i < xyz.count; ++i) {
    const key = of_cell(xyz.getX(i)) + 2 ** 17 * (of_cell(xyz.getY(i)) + 2 ** 17 * of_cell(xyz.getZ(i)));
    if (!firsts.has(key)) firsts.set(key, i);
    const at = (first[i] = firsts.get(key));
    ++counts[at];
    for (let k = 0; k < 3; ++k) middles[3 * at + k] += xyz.array[3 * i + k];
  }
  for (let i = 0; i < middles.length; ++i) middles[i] /= counts[Math.floor(i / 3)] || 1;
  const kept = [];
  for (let k = 0; k < triangles.length; k += 3) {
    const a = first[triangles[k]], b = first[triangles[k + 1]], c = first[triangles[k + 2]];
    if (a !== b && b !== c && c !== a) kept.push(a, b, c);
  }
  const coarse = new THREE.BufferGeometry();
  coarse.setAttribute("position", new THREE.BufferAttribute(middles, 3));
  coarse.setAttribute("color", geometry.getAttribute("color"));
  coarse.setIndex(kept);
  return coarse;
}

export class View3d {
  constructor(box, canvas) {
    this.box = box;
    this.view = "perspective";
    this.mode = "near";
    this.scale = 1;
    this.frames = 0;
    this.fps = 0;
    this.times = [];
    this.last = null;
    this.fast = 0;
    this.frame_ms = 0;
    this.bone_shown_ms = null;
    this.slices = [];
    this.shows_surface = true;
    this.is_dirty = true;
    this.label = document.getElementById("force-label");
    // Opaque, so that the browser need not blend it with what is behind: three.js always asks for an alpha channel.
    const context = canvas.getContext("webgl2", { alpha: false, antialias: false, powerPreference: "high-performance" });
    this.renderer = new THREE.WebGLRenderer({ canvas, context });
    this.renderer.outputColorSpace = THREE.LinearSRGBColorSpace;
    const gl = this.renderer.getContext(), info = gl.getExtension("WEBGL_debug_renderer_info");
    this.renderer_name = String(gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER));
    this.scene = new THREE.Scene();
    const sun = new THREE.DirectionalLight(0xffffff, 2.6);
    this.headlight = sun;
    this.scene.add(new THREE.AmbientLight(0xffffff, 1.6), sun);
    this.bone_group = new THREE.Group();
    this.scene.add(this.bone_group);
    this.perspective = new THREE.PerspectiveCamera(35, 1, 0.002, 5);
    this.along = new THREE.PerspectiveCamera(40, 1, 0.002, 5);
    this.above = new THREE.OrthographicCamera(-1, 1, 1, -1, 0.001, 5);
    for (const camera of [this.perspective, this.above]) camera.up.set(0, 0, 1);
    this.above.up.set(0, 1, 0);
    this.turn = new OrbitControls(this.perspective, canvas);
    this.shift = new OrbitControls(this.above, canvas);
    this.shift.enableRotate = false;
    this.shift.mouseButtons.LEFT = THREE.MOUSE.PAN;
    for (const control of [this.turn, this.shift]) control.addEventListener("change", () => (this.is_dirty = true));
    this.arrow = new THREE.Group();
    const orange = new THREE.MeshBasicMaterial({ color: 0xe69f00, depthTest: false, transparent: true });
    this.arrow_material = orange;
    const head = new THREE.ConeGeometry(0.0028, 0.007, 16).translate(0, -0.0035, 0);
    this.arrow_shaft = new THREE.Mesh(new THREE.CylinderGeometry(0.001, 0.001, 1, 10).translate(0, -0.5, 0), orange);
    this.arrow.add(new THREE.Mesh(head, orange), this.arrow_shaft);
    for (const part of this.arrow.children) part.renderOrder = 90;
    this.scene.add(this.arrow);
    this.surface_material = new THREE.MeshBasicMaterial({ vertexColors: true, transparent: true, opacity: 0.45, depthWrite: false });
    this.tool_material = new THREE.MeshLambertMaterial({ color: 0x93a4b5, transparent: true });
    this.ghost_material = new THREE.MeshLambertMaterial({ color: 0xe59bc4, transparent: true, opacity: 0.45, depthWrite: false });
    this.contour_material = new THREE.LineBasicMaterial({ color: 0xffffff, transparent: true, opacity: 0.4 });
    this.outline_material = new THREE.LineBasicMaterial({ color: 0xe69f00, depthTest: false, transparent: true });
    this.hole_material = new THREE.LineBasicMaterial({ color: 0xe69f00, transparent: true });
    this.disc_material = new THREE.MeshBasicMaterial({ color: 0x000000, side: THREE.DoubleSide });
    this.marks = new THREE.Group();
    this.scene.add(this.marks);
    new ResizeObserver(() => this.resize()).observe(box);
    this.set_theme();
    this.set_view("perspective");
  }

  set_theme() {
    const style = getComputedStyle(document.documentElement), of = (name) => style.getPropertyValue(name).trim();
    const is_light = document.documentElement.dataset.theme === "light";
    this.renderer.setClearColor(of("--view"), 1);
    this.contour_material.color.set(is_light ? 0x10161d : 0xffffff);
    this.tool_material.color.set(is_light ? 0x3d4a57 : 0x93a4b5);
    for (const material of [this.arrow_material, this.outline_material, this.hole_material]) material.color.set(of("--orange"));
    this.ghost_material.color.set(of("--pink"));
    this.disc_material.color.set(of("--view"));
    this.is_dirty = true;
  }

  /// `bone` of read_bone(), or null.
  set_bone(bone) {
    for (const part of [...this.bone_group.children]) this.drop(part);
    for (const name of ["tool", "ghost", "ring", "shape", "goals"]) {
      if (this[name]) this.drop(this[name]);
      this[name] = null;
    }
    this.set_marks([]);
    this.bone = bone;
    this.slices = [];
    this.surface = this.coarse_surface = null;
    this.is_dirty = true;
    if (!bone) return draw_legend(null);
    this.range = range_of([...bone.slices.map(({ hu }) => hu), bone.surface?.hu].filter(Boolean));
    draw_legend(this.range);
    for (const slice of bone.slices) this.slices.push(this.make_slice(slice));
    if (bone.surface) this.add_surface(bone.surface);
    this.make_tool(bone.tool);
    if (bone.goals) this.add_goals(bone.goals);
    this.fit();
  }

  drop(part) {
    part.traverse((node) => node.geometry?.dispose());
    part.removeFromParent();
  }

  geometry(places, width, triangles, hu) {
    const count = places.length / width, xyz = new Float32Array(3 * count);
    for (let i = 0; i < count; ++i) {
      xyz[3 * i] = places[width * i];
      xyz[3 * i + 1] = places[width * i + 1];
      if (width === 3) xyz[3 * i + 2] = places[3 * i + 2];
    }
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(xyz, 3));
    geometry.setAttribute("color", new THREE.BufferAttribute(colours_of(hu, this.range, count), 3, true));
    geometry.setIndex(new THREE.BufferAttribute(triangles, 1));
    return geometry;
  }

  add_goals(goals) {
    const style = getComputedStyle(document.documentElement), of = (name) => style.getPropertyValue(name).trim();
    this.goals = make_goals(goals, of("--green"), of("--red"));
    this.scene.add(this.goals);
  }

  make_slice({ slice, z_m, places, triangles, hu }) {
    const geometry = this.geometry(places, 2, triangles, hu);
    const mesh = new THREE.Mesh(geometry, sheet_material(0.6));
    const edges = new THREE.BufferGeometry();
    edges.setAttribute("position", geometry.getAttribute("position"));
    edges.setIndex(new THREE.BufferAttribute(boundary_of(triangles, places.length / 2), 1));
    const contour = new THREE.LineSegments(edges, this.contour_material);
    const group = new THREE.Group();
    group.add(mesh, contour);
    group.position.z = z_m;
    this.bone_group.add(group);
    return { slice, z_m, group, mesh, contour, places, triangles, hu };
  }

  add_surface({ places, triangles, hu }) {
    const geometry = this.geometry(places, 3, triangles, hu);
    this.light_surface(geometry);
    this.surface = new THREE.Mesh(geometry, this.surface_material);
    this.surface.renderOrder = 60;
    this.bone_group.add(this.surface);
    this.coarse_surface = null;
  }

  /// All of the surface at full resolution, else a coarse one: without a GPU its triangles take more time than its pixels.
  choose_surface() {
    if (!this.surface) return;
    const { geometry } = this.surface, is_coarse = this.drawn_scale < 1 && geometry.index.count > 3 * kCoarseTriangles;
    if (is_coarse && !this.coarse_surface) {
      this.coarse_surface = new THREE.Mesh(coarse_of(geometry), this.surface_material);
      this.coarse_surface.renderOrder = this.surface.renderOrder;
      this.bone_group.add(this.coarse_surface);
    }
    this.surface.visible = this.shows_surface && !is_coarse;
    if (this.coarse_surface) this.coarse_surface.visible = this.shows_surface && is_coarse;
  }

  /// Light from the front and above goes into the colours of the vertices: without a GPU that costs less than light in each pixel.
  light_surface(geometry) {
    geometry.computeVertexNormals();
    const normals = geometry.getAttribute("normal"), colours = geometry.getAttribute("color"), at = geometry.getAttribute("position"), index = geometry.index.array;
    let volume = 0;
    const a = new THREE.Vector3(), b = new THREE.Vector3(), c = new THREE.Vector3();
    for (let k = 0; k < index.length; k += 3)
      volume += a.fromBufferAttribute(at, index[k]).dot(b.fromBufferAttribute(at, index[k + 1]).cross(c.fromBufferAttribute(at, index[k + 2])));
    const out = volume < 0 ? -1 : 1;
    this.surface_material.side = out > 0 ? THREE.FrontSide : THREE.BackSide;
    const light = new THREE.Vector3(0.1, -0.7, 0.75).normalize();
    for (let i = 0; i < at.count; ++i) {
      const share = 0.75 + 0.55 * Math.max(-0.6, out * a.fromBufferAttribute(normals, i).dot(light));
      for (let k = 0; k < 3; ++k) colours.array[3 * i + k] = Math.min(255, colours.array[3 * i + k] * share);
    }
    geometry.deleteAttribute("normal");
  }

  make_tool({ outline_m, radius_m, kind, half_angle_deg }) {
    const outline = outline_m?.length ? outline_m : Array.from({ length: 24 }, (_, k) => [radius_m * Math.cos(k * Math.PI / 12), radius_m * Math.sin(k * Math.PI / 12)]);
    this.outline = outline;
    const shape = new THREE.Shape(outline.map(([x, y]) => new THREE.Vector2(x, y)));
    const prism = new THREE.ExtrudeGeometry(shape, { depth: kToolLength_m, bevelEnabled: false });
    if (kind && kind !== "flat" && half_angle_deg > 0) this.point_tip(prism, half_angle_deg);
    this.tool = new THREE.Mesh(prism, this.tool_material);
    this.tool.renderOrder = 50;
    this.ghost = new THREE.Mesh(prism.clone(), this.ghost_material);
    this.ghost.renderOrder = 55;
    this.ring = new THREE.LineLoop(new THREE.BufferGeometry().setFromPoints(outline.map(([x, y]) => new THREE.Vector3(x, y, 0))), this.outline_material);
    this.ring.renderOrder = 95;
    this.tool.visible = this.ghost.visible = false;
    this.scene.add(this.tool, this.ghost, this.ring);
  }

  /// The lower end becomes a point: the shaft begins where a cone of that angle has its width.
  point_tip(prism, half_angle_deg) {
    const at = prism.getAttribute("position"), radius = Math.max(...this.outline.map(([x, y]) => Math.hypot(x, y)));
    const length = radius / Math.tan(half_angle_deg * Math.PI / 180);
    const cone = new THREE.Shape(this.outline.map(([x, y]) => new THREE.Vector2(x, y)));
    const tip = new THREE.ExtrudeGeometry(cone, { depth: length, bevelEnabled: false }), low = tip.getAttribute("position");
    for (let i = 0; i < low.count; ++i) if (low.getZ(i) < length / 2) low.setXYZ(i, 0, 0, 0);
    for (let i = 0; i < at.count; ++i) if (at.getZ(i) < kToolLength_m / 2) at.setZ(i, length);
    prism.setAttribute("position", new THREE.BufferAttribute(new Float32Array([...at.array, ...low.array]), 3));
    prism.deleteAttribute("uv");
    prism.clearGroups();
    prism.computeVertexNormals();
  }

  /// A mesh of the sheet after a cut, from the session.
  set_sheet({ sheet, slice, places, triangles, hu, cuts }) {
    const old = this.slices[sheet];
    if (!old) return;
    if (!places.length) {
      old.is_lost = true;  // it outgrew its memory; the caption says so
      return;
    }
    const { z_m } = old;
    this.drop(old.group);
    this.slices[sheet] = { ...this.make_slice({ slice, z_m, places: places.slice(), triangles: triangles.slice(), hu: hu?.slice() ?? null }), cuts };
    this.is_dirty = true;
  }

  /// The sheet around the tool by the spring network: x, y and the share w of the tool's depth.
  set_shape(shape) {
    if (this.shape) this.drop(this.shape);
    this.shape = null;
    const sheet = this.slices[shape.sheet];
    if (!sheet || !shape.places.length) return;
    this.shape_w = new Float32Array(shape.places.length / 3);
    const flat = new Float32Array(shape.places.length);
    for (let i = 0; i < this.shape_w.length; ++i) {
      flat.set([shape.places[3 * i], shape.places[3 * i + 1], 0], 3 * i);
      this.shape_w[i] = shape.places[3 * i + 2];
    }
    const geometry = this.geometry(flat, 3, shape.triangles.slice(), null);
    this.paint_shape(geometry, sheet);
    this.shape = new THREE.Group();
    this.shape.add(new THREE.Mesh(geometry, sheet_material(0.9)));
    const wires = new THREE.Mesh(geometry, new THREE.MeshBasicMaterial({ wireframe: true, color: this.contour_material.color, transparent: true, opacity: 0.35 }));
    this.shape.add(wires);
    this.shape.position.z = sheet.z_m;
    this.shape_sheet = shape.sheet;
    this.scene.add(this.shape);
    this.is_dirty = true;
  }

  /// HU of the nearest vertex of the sheet.
  paint_shape(geometry, { places, hu }) {
    if (!hu) return;
    const at = geometry.getAttribute("position"), near = new Float32Array(at.count);
    for (let i = 0; i < at.count; ++i) {
      let best = Infinity;
      for (let k = 0; k < hu.length; ++k) {
        const d = (places[2 * k] - at.getX(i)) ** 2 + (places[2 * k + 1] - at.getY(i)) ** 2;
        if (d < best) {
          best = d;
          near[i] = hu[k];
        }
      }
    }
    geometry.setAttribute("color", new THREE.BufferAttribute(colours_of(near, this.range, at.count), 3, true));
  }

  /// Where a recording punctured: the tool's outline in the slice. [{x, y, z}]
  set_marks(places) {
    for (const part of [...this.marks.children]) this.drop(part);
    for (const { x, y, z } of places) {
      const loop = new THREE.LineLoop(this.ring.geometry.clone(), this.hole_material);
      const disc = new THREE.Mesh(new THREE.ShapeGeometry(new THREE.Shape(this.outline.map(([u, v]) => new THREE.Vector2(u, v)))), this.disc_material);
      loop.position.set(x, y, z + 2e-4);
      disc.position.set(x, y, z + 1e-4);
      this.marks.add(loop, disc);
    }
    this.is_dirty = true;
  }

  set_view(name) {
    this.view = name;
    this.turn.enabled = name === "perspective";
    this.shift.enabled = name === "section";
    this.camera = { perspective: this.perspective, tool: this.along, section: this.above }[name];
    this.resize();
  }

  set_mode(mode) {
    this.mode = mode;
    this.is_dirty = true;
  }

  fit() {
    const box = new THREE.Box3();
    for (const { group, mesh } of this.slices) {
      mesh.geometry.computeBoundingBox();
      box.union(mesh.geometry.boundingBox.clone().translate(group.position));
    }
    if (this.surface) box.union(new THREE.Box3().setFromBufferAttribute(this.surface.geometry.getAttribute("position")));
    if (box.isEmpty()) return;
    const centre = box.getCenter(new THREE.Vector3()), size = box.getSize(new THREE.Vector3());
    this.turn.target.copy(centre);
    this.extent = box;
    this.shift.target.copy(centre);
    this.above.position.set(centre.x, centre.y, box.max.z + 0.5);
    this.half = 0.64 * Math.max(size.y, 0.02);
    this.half_x = 0.64 * Math.max(size.x, 0.02);
    this.above.zoom = 1;
    this.resize();
    this.look_at_all(centre, size.length());
  }

  /// From the front and above, as near as all of the bone can be seen.
  look_at_all(centre, size) {
    const from = new THREE.Vector3(0.42, -0.78, 0.5).normalize(), corner = new THREE.Vector3();
    let away = 0.6 * size;
    for (let turn = 0; turn < 40; ++turn, away *= 1.06) {
      this.perspective.position.copy(centre).addScaledVector(from, away);
      this.perspective.lookAt(centre);
      this.perspective.updateMatrixWorld();
      let most = 0;
      for (let k = 0; k < 8; ++k) {
        corner.set(k & 1 ? this.extent.max.x : this.extent.min.x, k & 2 ? this.extent.max.y : this.extent.min.y, k & 4 ? this.extent.max.z : this.extent.min.z);
        corner.project(this.perspective);
        most = Math.max(most, Math.abs(corner.x), Math.abs(corner.y));
      }
      if (most < 1.1) break;
    }
    this.turn.update();
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.box;
    if (!width || !height) return;
    Object.assign(this, { width, height, rem: parseFloat(getComputedStyle(document.documentElement).fontSize) });
    this.drawn_scale = this.scale;
    this.renderer.setPixelRatio(this.scale * window.devicePixelRatio);
    this.renderer.setSize(width, height, false);
    for (const camera of [this.perspective, this.along]) {
      camera.aspect = width / height;
      camera.updateProjectionMatrix();
    }
    const half = Math.max(this.half ?? 0.05, (this.half_x ?? 0.05) * height / width);
    Object.assign(this.above, { top: 1.1 * half, bottom: -0.9 * half, left: -half * width / height, right: half * width / height });
    this.above.updateProjectionMatrix();
    this.turn.update();
    this.shift.update();
    this.is_dirty = true;
  }

  place(tool, shown) {
    const tip = shown.values("tool_m"), axis = shown.values("axis"), q = shown.values("q");
    tool.visible = Boolean(tip);
    if (!tip) return;
    tool.position.set(tip[0], tip[1], tip[2]);
    const turn = q ? new THREE.Quaternion(q[1], q[2], q[3], q[0]) : new THREE.Quaternion();
    if (axis) {  // of the scene's tool, which may be tilted on the plate
      const up = new THREE.Vector3(-axis[0], -axis[1], -axis[2]).normalize();
      const x = new THREE.Vector3(1, 0, 0).applyQuaternion(turn);
      x.addScaledVector(up, -x.dot(up)).normalize();
      turn.setFromRotationMatrix(new THREE.Matrix4().makeBasis(x, new THREE.Vector3().crossVectors(up, x), up));
    } else if (this.bone?.tool.axis_in_plate) {
      turn.multiply(new THREE.Quaternion().setFromUnitVectors(new THREE.Vector3(0, 0, 1), new THREE.Vector3(...this.bone.tool.axis_in_plate).normalize()));
    }
    tool.quaternion.copy(turn);
  }

  /// The slice of the cross-section: the active one, else the next below the tip.
  section_slice(shown) {
    const active = shown?.value("active_slice", -1) ?? -1;
    const found = this.slices.findIndex(({ slice }) => slice === active);
    if (found >= 0) return found;
    const tip = shown?.values("tool_m");
    if (!tip) return 0;
    const below = this.slices.findIndex(({ z_m }) => z_m <= tip[2]);
    return below >= 0 ? below : this.slices.length - 1;
  }

  /// Moves everything to the present row.
  update(shown) {
    this.shown = shown;
    if (!this.bone) return;
    this.is_dirty = true;
    this.place(this.tool, shown);
    this.ghost.visible = false;
    if (shown.second?.row) this.place(this.ghost, shown.second);
    const tip = shown.values("tool_m");
    const near = this.section_slice(shown), is_section = this.view === "section";
    this.near = near;
    const has_surface = Boolean(this.surface) && this.mode !== "all";
    for (const [k, slice] of this.slices.entries()) {
      const is_near = Math.abs(k - near) <= kNearSlices;
      slice.group.visible = is_section ? k === near : this.mode === "surface" && this.surface ? false : has_surface ? is_near : true;
      slice.mesh.material.opacity = is_section ? 1 : k === near ? 0.95 : this.slices.length > 12 && !has_surface ? 0.4 : 0.7;
      slice.mesh.renderOrder = 30 - 0.1 * k;
      slice.contour.renderOrder = 31 - 0.1 * k;
    }
    this.contour_material.opacity = is_section ? 0.95 : 0.4;
    this.shows_surface = has_surface && !is_section;
    this.ring.visible = is_section && Boolean(tip);
    if (is_section) this.tool.visible = false;
    for (const tool of [this.tool, this.ghost]) tool.scale.z = this.view === "tool" ? kStub : 1;
    this.tool_material.opacity = this.view === "tool" ? 0.3 : 1;
    if (tip && this.slices[near]) {
      this.ring.position.set(tip[0], tip[1], is_section ? this.slices[near].z_m + 1e-3 : tip[2]);
      this.ring.quaternion.copy(this.tool.quaternion);
    }
    for (const mark of this.marks.children)
      mark.visible = !is_section || Math.abs(mark.position.z - this.slices[near].z_m) < 3e-4 ;
    this.bend(shown);
    this.point(shown, tip);
    if (this.view === "tool" && tip) this.look_along(tip, shown.values("axis"));
  }

  bend(shown) {
    if (!this.shape) return;
    const is_active = shown.value("active_sheet", -1) === this.shape_sheet && this.view !== "section";
    this.shape.visible = is_active;
    if (!is_active) return;
    this.slices[this.shape_sheet].mesh.material.opacity = 0.12;
    const at = this.shape.children[0].geometry.getAttribute("position"), depth = Math.max(0, shown.value("penetration_m", 0));
    this.shape_depth_m = 0;
    for (let i = 0; i < this.shape_w.length; ++i) {
      at.setZ(i, -depth * this.shape_w[i]);
      this.shape_depth_m = Math.max(this.shape_depth_m, depth * this.shape_w[i]);
    }
    at.needsUpdate = true;
  }

  /// The arrow of the force on the tool ends at the tip.
  point(shown, tip) {
    const force = shown.values("wrench_delivered"), N = force ? Math.hypot(force[0], force[1], force[2]) : 0;
    this.arrow_N = N;
    this.arrow.visible = Boolean(tip) && N > kLeastArrow_N && this.view === "perspective";
    if (!this.arrow.visible) return;
    const direction = new THREE.Vector3(force[0], force[1], force[2]).divideScalar(N);
    this.arrow.position.set(tip[0], tip[1], tip[2]);
    this.arrow.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), direction);
    this.arrow_shaft.scale.y = Math.max(0.008, N * kArrow_m_per_N);
    this.arrow_tail = this.arrow.position.clone().addScaledVector(direction, -this.arrow_shaft.scale.y);
  }

  look_along(tip, axis) {
    const down = axis ? new THREE.Vector3(axis[0], axis[1], axis[2]) : new THREE.Vector3(0, 0, -1);
    const at = new THREE.Vector3(tip[0], tip[1], tip[2]);
    this.along.up.set(0, 1, 0);
    this.along.position.copy(at).addScaledVector(down, -0.1);
    this.along.lookAt(at);
  }

  /// Renders if something changed; `now` in ms. True: the resolution has changed.
  frame(now) {
    if (!this.bone) return false;
    if (!this.is_dirty) return this.rest(now);
    this.is_dirty = this.is_sharp = false;
    this.set_scale(this.scale);
    this.render();
    this.pace(now);
    return false;
  }

  /// Nothing moves: one picture at full resolution.
  rest(now) {
    if (this.is_sharp || this.scale === 1 || now - this.last < kRest_ms) return false;
    this.is_sharp = true;
    this.set_scale(1);
    this.render();
    this.last = null;
    return true;
  }

  set_scale(scale) {
    if (scale === this.drawn_scale) return;
    this.drawn_scale = scale;
    this.renderer.setPixelRatio(scale * window.devicePixelRatio);
  }

  render() {
    this.choose_surface();
    this.headlight.position.copy(this.camera.position);
    this.headlight.target.position.copy(this.turn.target);
    this.headlight.target.updateMatrixWorld();
    this.renderer.render(this.scene, this.camera);
    if (this.bone_shown_ms === null) this.bone_shown_ms = performance.now();
    this.put_labels();
  }

  pace(now) {
    ++this.frames;
    if (this.last !== null && now - this.last < 500) this.times.push(now - this.last);
    this.last = now;
    if (this.times.length < 20) return;
    const mean = this.times.reduce((a, b) => a + b) / this.times.length;
    this.times = [];
    this.fps = 1000 / mean;
    this.frame_ms = mean;
    const before = this.scale;
    if (mean > kSlowFrame_ms) this.scale = Math.max(kLeastScale, this.scale * Math.max(0.7, Math.sqrt(kSlowFrame_ms / mean) * 0.95));
    else if (mean < kFastFrame_ms && this.scale < 1 && ++this.fast >= 5) this.scale = Math.min(1, this.scale * 1.12);
    else return;
    this.fast = this.scale < before ? -20 : 0;  // a step up that was too much is not tried again soon
  }

  put_labels() {
    const { width, height, rem } = this;
    this.label.hidden = !this.arrow.visible;
    if (this.arrow.visible) {
      const at = this.arrow_tail.clone().project(this.camera);
      const x = Math.min(width - 12 * rem, Math.max(rem, (at.x + 1) / 2 * width + rem)), y = Math.min(height - 6 * rem, Math.max(5 * rem, (1 - at.y) / 2 * height));
      this.label.style.transform = `translate(${x}px, ${y}px)`;
    }
    const bar = document.getElementById("scale-bar");
    bar.hidden = this.view !== "section";
    if (!bar.hidden) {
      const px_per_m = height / (this.above.top - this.above.bottom) * this.above.zoom;
      const mm = [50, 20, 10, 5, 2, 1].find((length) => length / 1000 * px_per_m < width / 4) ?? 1;
      bar.firstElementChild.style.width = `${mm / 1000 * px_per_m}px`;
      bar.lastElementChild.textContent = `${mm} mm`;
    }
  }

  renderer_words() {
    const found = /llvmpipe|SwiftShader|SVGA3D|virgl/i.exec(this.renderer_name)?.[0];
    const name = found ? `${found} (no GPU)` : this.renderer_name.replace(/^ANGLE \([^,]*, /, "").replace(/,.*$/, "").slice(0, 36);
    return `${name}, ${Math.round(this.fps) || "–"} frames/s, scale ${(this.drawn_scale ?? 1).toFixed(2)}`;
  }
}
