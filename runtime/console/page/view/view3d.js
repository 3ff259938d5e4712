// SPDX-License-Identifier: Apache-2.0
// The three-dimensional view: bone, tool, bending sheet, holes, force. Coordinates are in {B}, in metres, with z up.
import * as THREE from "three";
import { Cameras } from "./cameras.js";
import { ForceArrow } from "./force_arrow.js";
import { make_goals } from "./goals3d.js";
import { colours_of, draw_legend, range_of } from "./hu.js";
import { boundary_of, coarse_of, kCoarseTriangles, light, mesh_geometry } from "./mesh_geometry.js";
import { Pace } from "./pace.js";
import { ToolModel } from "./tool_model.js";

const kNearSlices = 3;  // number of slices shown on each side of the tip
const kRest_ms = 400;
const kPlanned_m = 0.0015;  // radius of the spheres at a planned entry and target

THREE.ColorManagement.enabled = false;  // the colours of the HU map are shown unchanged

const sheet_material = (opacity) =>
  new THREE.MeshBasicMaterial({ vertexColors: true, transparent: true, opacity, depthWrite: false, side: THREE.DoubleSide, forceSinglePass: true });

const colour_of_page = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

export class View3d {
  constructor(box, canvas) {
    this.box = box;
    this.view = "perspective";
    this.mode = "near";
    this.pace = new Pace();
    this.bone_shown_ms = null;
    this.slices = [];
    this.shows_surface = true;
    this.allows_arrow = true;
    this.is_dirty = true;
    this.label = document.getElementById("force-label");
    // The context is opaque, so that the browser need not blend it with the background. (three.js always asks for an alpha channel.)
    const context = canvas.getContext("webgl2", { alpha: false, antialias: false, powerPreference: "high-performance" });
    this.renderer = new THREE.WebGLRenderer({ canvas, context });  // it asks for a lost context again, and restores what it had
    this.is_lost = false;
    for (const [name, is_lost] of [["webglcontextlost", true], ["webglcontextrestored", false]])
      canvas.addEventListener(name, () => {
        this.is_lost = is_lost;
        if (!is_lost) this.set_theme();  // three.js restores all but the colour behind the picture
        this.is_dirty = true;
        this.on_context?.();
      });
    this.renderer.outputColorSpace = THREE.LinearSRGBColorSpace;
    const gl = this.renderer.getContext(), info = gl.getExtension("WEBGL_debug_renderer_info");
    this.renderer_name = String(gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER));
    this.scene = new THREE.Scene();
    this.headlight = new THREE.DirectionalLight(0xffffff, 2.6);
    this.scene.add(new THREE.AmbientLight(0xffffff, 1.6), this.headlight);
    this.bone_group = new THREE.Group();
    this.scene.add(this.bone_group);
    this.cameras = new Cameras(canvas, () => (this.is_dirty = true));
    this.arrow_material = new THREE.MeshBasicMaterial({ color: 0xe69f00, depthTest: false, transparent: true });
    this.arrow = new ForceArrow(this.scene, this.arrow_material);
    this.surface_material = new THREE.MeshBasicMaterial({ vertexColors: true, transparent: true, opacity: 0.45, depthWrite: false });
    this.tool_material = new THREE.MeshLambertMaterial({ color: 0x93a4b5, transparent: true });
    this.ghost_material = new THREE.MeshLambertMaterial({ color: 0xe59bc4, transparent: true, opacity: 0.45, depthWrite: false });
    this.contour_material = new THREE.LineBasicMaterial({ color: 0xffffff, transparent: true, opacity: 0.4 });
    this.outline_material = new THREE.LineBasicMaterial({ color: 0xe69f00, depthTest: false, transparent: true });
    this.hole_material = new THREE.LineBasicMaterial({ color: 0xe69f00, transparent: true });
    this.disc_material = new THREE.MeshBasicMaterial({ color: 0x000000, side: THREE.DoubleSide });
    this.marks = new THREE.Group();
    this.scene.add(this.marks);
    this.ray = new THREE.Raycaster();
    new ResizeObserver(() => this.resize()).observe(box);
    this.set_theme();
    this.set_view("perspective");
  }

  set_theme() {
    const is_light = document.documentElement.dataset.theme === "light";
    this.renderer.setClearColor(colour_of_page("--view"), 1);
    this.contour_material.color.set(is_light ? 0x10161d : 0xffffff);
    this.tool_material.color.set(is_light ? 0x3d4a57 : 0x93a4b5);
    for (const material of [this.arrow_material, this.outline_material, this.hole_material]) material.color.set(colour_of_page("--orange"));
    this.ghost_material.color.set(colour_of_page("--pink"));
    this.disc_material.color.set(colour_of_page("--view"));
    this.is_dirty = true;
  }

  /// Shows a bone. `bone`: result of read_bone(), or null.
  set_bone(bone) {
    for (const part of [...this.bone_group.children]) this.drop(part);
    for (const part of [...(this.tool?.parts ?? []), this.shape, this.goals, this.plan]) if (part) this.drop(part);
    this.tool = this.shape = this.goals = this.plan = this.plan_at = null;
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
    this.tool = new ToolModel(bone.tool, this.scene, { tool: this.tool_material, ghost: this.ghost_material, outline: this.outline_material });
    if (bone.goals) this.scene.add((this.goals = make_goals(bone.goals, colour_of_page("--green"), colour_of_page("--red"))));
    this.fit();
  }

  drop(part) {
    part.traverse((node) => node.geometry?.dispose());
    part.removeFromParent();
  }

  make_slice({ slice, z_m, positions, triangles, hu }) {
    const geometry = mesh_geometry(positions, 2, triangles, hu, this.range);
    const mesh = new THREE.Mesh(geometry, sheet_material(0.6));
    const edges = new THREE.BufferGeometry();
    edges.setAttribute("position", geometry.getAttribute("position"));
    edges.setIndex(new THREE.BufferAttribute(boundary_of(triangles, positions.length / 2), 1));
    const contour = new THREE.LineSegments(edges, this.contour_material);
    const group = new THREE.Group();
    group.add(mesh, contour);
    group.position.z = z_m;
    this.bone_group.add(group);
    return { slice, z_m, group, mesh, contour, positions, triangles, hu };
  }

  add_surface({ positions, triangles, hu }) {
    const geometry = mesh_geometry(positions, 3, triangles, hu, this.range);
    this.surface_material.side = light(geometry);
    this.surface = new THREE.Mesh(geometry, this.surface_material);
    this.surface.renderOrder = 60;
    this.bone_group.add(this.surface);
  }

  /// Shows the whole surface at full resolution, and a coarse surface at reduced resolution. Without a GPU the triangles of the surface
  /// take more time than its pixels.
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

  /// Replaces a sheet by its mesh after a cut, as the session gives it.
  set_sheet({ sheet, slice, positions, triangles, hu, cuts }) {
    const old = this.slices[sheet];
    if (!old) return;
    if (!positions.length) {
      old.is_lost = true;  // the sheet has outgrown its memory; the caption says so
      return;
    }
    const { z_m } = old;
    this.drop(old.group);
    this.slices[sheet] = { ...this.make_slice({ slice, z_m, positions: positions.slice(), triangles: triangles.slice(), hu: hu?.slice() ?? null }), cuts };
    this.is_dirty = true;
  }

  /// Shows the sheet around the tool with the spring network. A vertex has x, y and w, the fraction of the tool's depth by which it is
  /// lowered.
  set_shape(shape) {
    if (this.shape) this.drop(this.shape);
    this.shape = null;
    const sheet = this.slices[shape.sheet];
    if (!sheet || !shape.positions.length) return;
    this.shape_w = new Float32Array(shape.positions.length / 3);
    const flat = new Float32Array(shape.positions.length);
    for (let i = 0; i < this.shape_w.length; ++i) {
      flat.set([shape.positions[3 * i], shape.positions[3 * i + 1], 0], 3 * i);
      this.shape_w[i] = shape.positions[3 * i + 2];
    }
    const geometry = mesh_geometry(flat, 3, shape.triangles.slice(), null, this.range);
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

  /// Gives each vertex the colour of the sheet's nearest vertex.
  paint_shape(geometry, { positions, hu }) {
    if (!hu) return;
    const at = geometry.getAttribute("position"), near = new Float32Array(at.count);
    for (let i = 0; i < at.count; ++i) {
      let best = Infinity;
      for (let k = 0; k < hu.length; ++k) {
        const d = (positions[2 * k] - at.getX(i)) ** 2 + (positions[2 * k + 1] - at.getY(i)) ** 2;
        if (d < best) {
          best = d;
          near[i] = hu[k];
        }
      }
    }
    geometry.setAttribute("color", new THREE.BufferAttribute(colours_of(near, this.range, at.count), 3, true));
  }

  /// Draws the tool's outline in the slice at each point at which a recording punctured: [{x, y, z}].
  set_marks(positions) {
    for (const part of [...this.marks.children]) this.drop(part);
    for (const { x, y, z } of positions) {
      const loop = new THREE.LineLoop(this.tool.ring.geometry.clone(), this.hole_material);
      const disc = new THREE.Mesh(this.tool.disc(), this.disc_material);
      loop.position.set(x, y, z + 2e-4);
      disc.position.set(x, y, z + 1e-4);
      this.marks.add(loop, disc);
    }
    this.is_dirty = true;
  }

  /// Shows a needle's way that is planned: {entry, end, target?, at} in {B}; null: none. The cross-section is at the height of `at`.
  set_plan(plan) {
    if (this.plan) this.drop(this.plan);
    this.plan = null;
    this.plan_at = plan?.at ?? null;
    this.is_dirty = true;
    if (!plan) return;
    const at = (at_m) => ({ target: { at_m, radius_m: kPlanned_m } }), good = colour_of_page("--green"), first = colour_of_page("--blue");
    this.plan = make_goals({ line: { entry_m: plan.entry, to_m: plan.end } }, good);
    this.plan.add(make_goals(at(plan.entry), first));
    if (plan.target) this.plan.add(make_goals(at(plan.target), good));
    this.scene.add(this.plan);
  }

  /// Returns the point of the bone at a pixel of the view, in {B}; null if there is no bone.
  pick(x, y) {
    if (!this.bone) return null;
    const at = new THREE.Vector2(2 * x / this.width - 1, 1 - 2 * y / this.height);
    this.ray.setFromCamera(at, this.cameras.active);
    const shown = this.slices.filter(({ group }) => group.visible).map(({ mesh }) => mesh);
    if (this.surface && this.shows_surface) shown.push(this.surface);
    return this.ray.intersectObjects(shown, false)[0]?.point.toArray() ?? null;
  }

  /// Returns the pixel of the view at which a position in {B} is drawn.
  pixel_of(at_m) {
    const { x, y } = new THREE.Vector3(...at_m).project(this.cameras.active);
    return [(x + 1) / 2 * this.width, (1 - y) / 2 * this.height];
  }

  set_view(name) {
    this.view = name;
    this.cameras.choose(name);
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
    this.cameras.aim(box);
    this.resize();
    this.cameras.frame_all(box);
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.box;
    if (!width || !height) return;
    Object.assign(this, { width, height, rem: parseFloat(getComputedStyle(document.documentElement).fontSize) });
    this.drawn_scale = this.pace.scale;
    this.renderer.setPixelRatio(this.pace.scale * window.devicePixelRatio);
    this.renderer.setSize(width, height, false);
    this.cameras.resize(width, height);
    this.is_dirty = true;
  }

  /// Returns the index of the slice in a cross-section: the active slice, otherwise the next slice below the tip.
  section_slice(shown) {
    const active = shown?.value("active_slice", -1) ?? -1;
    const found = this.slices.findIndex(({ slice }) => slice === active);
    if (found >= 0) return found;
    const tip = this.plan_at ?? shown?.values("tool_m");
    if (!tip) return 0;
    const below = this.slices.findIndex(({ z_m }) => z_m <= tip[2] + 1e-5);
    return below >= 0 ? below : this.slices.length - 1;
  }

  /// Moves everything to the present row.
  update(shown) {
    if (!this.bone) return;
    this.is_dirty = true;
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
    this.tool.update(shown, this.view, this.slices[near]?.z_m);
    this.tool_material.opacity = this.view === "tool" ? 0.3 : 1;
    for (const mark of this.marks.children)
      mark.visible = !is_section || Math.abs(mark.position.z - this.slices[near].z_m) < 3e-4;
    this.bend(shown);
    this.arrow.update(shown.values("wrench_delivered"), tip, this.view === "perspective" && this.allows_arrow);
    if (this.view === "tool" && tip) this.cameras.follow(tip, shown.values("axis"));
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

  /// Renders if something has changed. `now` is in ms. Returns true if the resolution has changed.
  frame(now) {
    if (!this.bone) {
      if (this.is_dirty) this.renderer.clear();
      return this.is_dirty = false;
    }
    if (!this.is_dirty) return this.rest(now);
    this.is_dirty = this.is_sharp = false;
    this.set_scale(this.pace.scale);
    this.render();
    this.pace.frame(now);
    return false;
  }

  /// Draws one picture at full resolution when nothing moves any more.
  rest(now) {
    if (this.is_sharp || this.pace.scale === 1 || this.pace.since_last(now) < kRest_ms) return false;
    this.is_sharp = true;
    this.set_scale(1);
    this.render();
    this.pace.pause();
    return true;
  }

  set_scale(scale) {
    if (scale === this.drawn_scale) return;
    this.drawn_scale = scale;
    this.renderer.setPixelRatio(scale * window.devicePixelRatio);
  }

  render() {
    this.choose_surface();
    this.headlight.position.copy(this.cameras.active.position);
    this.headlight.target.position.copy(this.cameras.turn.target);
    this.headlight.target.updateMatrixWorld();
    this.renderer.render(this.scene, this.cameras.active);
    if (this.bone_shown_ms === null) this.bone_shown_ms = performance.now();
    this.put_labels();
  }

  put_labels() {
    const { width, height, rem } = this;
    this.label.hidden = !this.arrow.visible || height < 12 * rem;  // the readout says it, too
    if (!this.label.hidden) {
      const at = this.arrow.tail.clone().project(this.cameras.active);
      const x = Math.min(width - 12 * rem, Math.max(rem, (at.x + 1) / 2 * width + rem)), y = Math.min(height - 6 * rem, Math.max(5 * rem, (1 - at.y) / 2 * height));
      this.label.style.transform = `translate(${x}px, ${y}px)`;
    }
    const bar = document.getElementById("scale-bar");
    bar.hidden = this.view !== "section";
    if (!bar.hidden) {
      const px_per_m = this.cameras.section_scale(height);
      const mm = [50, 20, 10, 5, 2, 1].find((length) => length / 1000 * px_per_m < width / 4) ?? 1;
      bar.firstElementChild.style.width = `${mm / 1000 * px_per_m}px`;
      bar.lastElementChild.textContent = `${mm} mm`;
    }
  }
}
