// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/program/arguments.h"

#include <utility>

#include "formats/asset/asset.h"
#include "pipeline/program/presets.h"

namespace trocar::pipeline {
namespace {

// The options of one topic of the help.
class Group {
 public:
  Group(const Command& command, const char* name) : command_(command), name_(name) {}

  // A number within a range. The help shows `unit` after the option's name.
  template <typename Number>
  Option number(const char* name, Number& value, const char* unit, Number low, Number high,
                const char* help) {
    return number_if_given(name, value, unit, low, high, help).with_default_shown();
  }
  // The same without a default.
  template <typename Number>
  Option number_if_given(const char* name, Number& value, const char* unit, Number low, Number high,
                         const char* help) {
    return command_.option(name, value, help).within(low, high, unit).in_group(name_);
  }
  // An option without a default. The help shows `form`, the form of its value.
  template <typename Value>
  Option value(const char* name, Value& value, const char* form, const char* help) {
    return command_.option(name, value, help).with_form(form).in_group(name_);
  }
  Option choice(const char* name, std::string& value, std::vector<std::string> words,
                const char* help) {
    return command_.option(name, value, help).one_of(std::move(words)).in_group(name_);
  }
  void flag(const char* name, bool& value, const char* help) {
    command_.flag(name, value, help).in_group(name_);
  }

 private:
  Command command_;
  const char* name_;
};

void add_input_options(const Command& command, Arguments& a) {
  command.option("INPUT", a.inputs, "the scan");
  Group group(command, "Input");
  group.value(
      "--spacing", a.spacing, "X,Y,Z",
      "pixel width, pixel height and distance of slices, in mm; for INPUT that does not state\n"
      "them");
  group.value("--slices", a.slices, "A:B",
              "mesh only the slices A to B, both included, counted from 0");
  group.value("--crop", a.crop, "X0:X1,Y0:Y1",
              "mesh only the columns X0 to X1 and rows Y0 to Y1, all included, counted from 0");
  group.value("--series", a.series, "SERIES",
              "if INPUT holds several series: the one to mesh, by its UID, number or description");
  a.volume_option = group.number_if_given(
      "--volume", a.volume, "N", 0, 1'000'000'000,
      "for a NIfTI or NRRD file (4D) or a DICOM series with several volumes: the one to mesh,\n"
      "counted from 0");
  group.flag("--any-modality", a.any_modality,
             "accept DICOM images other than CT. Their values are not HU (Hounsfield units, the\n"
             "calibrated grey levels of CT)");
  group.flag("--completeness-unknown", a.completeness_unknown,
             "nobody has said how many images the scan has: the report warns of it, and the\n"
             "asset says so");
  a.axis_option = group.choice(
      "--axis", a.axis, {"axial", "transverse", "coronal", "sagittal"},
      "plane of the slices; transverse means axial, that is, across the body. Default: axial\n"
      "for a NIfTI or NRRD file; for other input, the plane in which the slices are stored");
  group.value(
      "--hu", a.hu, "CT",
      "with --labels: the CT that gives the HU. It must have the same grid of voxels (size,\n"
      "spacing, position) as the label map");
}

void add_material_options(const Command& command, Arguments& a) {
  Group group(command, "Material");
  std::vector<std::string> names;
  for (const Preset& preset : presets())
    names.emplace_back(preset.name);
  group.choice(
      "--preset", a.preset, std::move(names),
      "use the options that suit this material; --explain prints them. (paper: for images, the\n"
      "method of the publication that Trocar follows)");
  group.flag("--explain", a.explain,
             "print the options that --preset stands for; without --preset, those of every preset");
  a.threshold_option =
      group.number("--threshold", a.threshold, "HU", -1e6, 1e6,
                   "lowest HU that counts as material (226: dense bone, 180: bone of low\n"
                   "density, -300: skin). If INPUT is images: a grey level from 0 to 255");
  a.equalize_option = group.number_if_given(
      "--equalize", a.equalize, "LEVEL", 0.0, 255.0,
      "instead of --threshold: spread the grey levels of each slice evenly over 0 to 255\n"
      "(histogram equalisation), then mesh all pixels of at least LEVEL. Without this "
      "option,\n"
      "grey levels are not spread. The preset paper sets LEVEL to 230");
  a.labels_option = group
                        .value("--labels", a.labels, "L",
                               "INPUT is a label map: its voxels hold numbers of structures. Mesh "
                               "the structures L: a\n"
                               "number, a range A-B, several of these, or all. Each becomes one "
                               "material; 20+21 joins\n"
                               "two structures to one material")
                        .one_value_each();
  group.value(
      "--names", a.names, "FILE",
      "names of the labels: a JSON file such as {\"20\": \"L1\"}; or verse, for label maps of\n"
      "the data set VerSe; or totalsegmentator, for those of the program TotalSegmentator");
  a.min_region_option = group.number(
      "--min-region", a.min_region_mm2, "MM2", 0.0, 1e12,
      "in each slice, drop islands of material and fill holes whose area is smaller than this,\n"
      "mm^2. Default for pixels narrower than 0.3 mm: at most 4 pixels");
  group.flag("--keep-table", a.keep_table,
             "mesh the scanner's table, too. Without this option, the table is left out if it\n"
             "is separate from the patient's bone");
}

// Options of solid_bone.h.
void add_solid_options(const Command& command, Arguments& a) {
  Group group(command, "Solid bone");
  group.value(
      "--fill", a.fill, "MM2",
      "fill what bone encloses, such as marrow, so that it becomes material: a voxel is filled\n"
      "if bone encloses it in at least two of the axial, coronal and sagittal planes. Canals,\n"
      "such as the spinal canal, stay open. MM2 is the largest area that is filled in a plane,\n"
      "mm^2; all: no limit");
  group.number(
      "--close", a.close_mm, "MM", 0.0, 100.0,
      "with --fill: gaps in the bone count as closed if they are at most 2 x MM mm wide.\n"
      "A region that is open only at such gaps then counts as enclosed and is filled, too");
  group.number(
      "--min-volume", a.min_volume_mm3, "MM3", 0.0, 1e12,
      "drop separate pieces (connected components) of less than this volume, mm^3. This is\n"
      "done before --fill");
  group
      .choice("--keep", a.keep, {"all", "column"},
              "'all' keeps all bone. 'column' needs --fill and keeps only the spinal column:\n"
              "vessels full of contrast medium, which are as dense as bone, are dropped, and\n"
              "ribs are cut off 75 mm from the spinal canal")
      .with_default_shown();
  group.number("--largest", a.largest, "N", 0, 1'000'000,
               "keep only the N largest connected components; 0: keep all");
  group
      .value(
          "--seed", a.seeds, "X,Y,Z",
          "keep only the material connected to this point (mm in DICOM's patient coordinates:\n"
          "x to the patient's left, y to the back, z to the head). If an unwanted bone touches\n"
          "the wanted one, give a second point in the unwanted bone: material that is nearer to\n"
          "the second point than to the first is dropped. More such points may follow")
      .one_value_each();
  group.value("--mask", a.mask, "LABELS.nii.gz:L[,L]",
              "keep only the material within 1.5 mm of the labels L of this label map");
}

void add_stage_options(const Command& command, Arguments& a) {
  Group group(command, "Mesh");
  group
      .choice("--contour", a.contour, {"subpixel", "pixel"},
              "where the border of the material runs. subpixel: between pixel centres, where the\n"
              "interpolated value is the threshold; pixel: through the centres of the outermost "
              "pixels\n"
              "of the material")
      .with_default_shown();
  group
      .choice(
          "--simplify", a.simplify, {"area", "dp"},
          "how outlines are simplified. area: vertices are merged so that each outline keeps its\n"
          "area; dp: vertices are left out (method of Douglas and Peucker), and areas change")
      .with_default_shown();
  a.tolerance_option =
      group.number("--tolerance", a.tolerance_mm, "MM", 0.0, 1e4,
                   "largest distance of the simplified outline from the original one, mm. Default\n"
                   "for pixels narrower than 0.3 mm: at most 0.4 pixels");
  group.number("--min-angle", a.min_angle_deg, "DEG", 0.0, 60.0,
               "smallest angle of a triangle, degrees");
  a.area_option = group.number("--max-area", a.max_area_mm2, "MM2", 1e-6, 1e12,
                               "largest area of a triangle, mm^2");
  a.area_px_option =
      group.number_if_given("--max-area-px", a.max_area_px2, "PX2", 1e-6, 1e12,
                            "largest area of a triangle in pixels, instead of --max-area");
  group.number("--grade", a.grade_hu, "HU", 0.0, 1e6,
               "use smaller triangles where the HU change by more than this along an edge of\n"
               "a triangle; 0: never");
  a.lattice_option = group.number(
      "--lattice-bits", a.lattice_bits, "N", kMinLatticeBits, kMaxLatticeBits,
      "precision: all coordinates are multiples of 2^-N mm. Default for pixels narrower\n"
      "than 0.25 mm: at least 64 steps a pixel");
}

// Options of the asset. A preview accepts them without effect, so that the options of a run can be
// given to its preview, and hides them from its help.
void add_asset_options(Group group, Arguments& a) {
  group.flag("--no-hu", a.no_hu, "store no HU in the asset");
  group.flag("--surface", a.surface,
             "add a closed surface of the material to the asset, for display and for trocar-mesh\n"
             "export --surface");
  a.surface_triangles_option = group.number(
      "--surface-triangles", a.surface_triangles, "N", 100, 5'000'000,
      "limit on the number of triangles of the surface. Without this option, the limit begins at\n"
      "50000, and is doubled until 99 % of the surface lies within half a voxel of the\n"
      "material's boundary. The surface may have more triangles than the limit: some are added\n"
      "where it would otherwise intersect itself");
  group.flag("--lines", a.lines, "also store the outlines as lines, for 3D viewers");
  group.flag("--colour", a.colour,
             "also store HU as colours for 3D viewers, from dark (-200 HU) to light (1848 HU)");
  a.context_option = group
                         .value("--context", a.context, "[MM]",
                                "also store the HU around the material, for simulated X-ray "
                                "pictures: one value every\n"
                                "MM mm (default: 2 to 4 mm, depending on the size of the scan). In "
                                "a scan of a head,\n"
                                "these HU can show the patient's face")
                         .with_optional_value();
  group.value(
      "--input-key", a.input_key, "FILE",
      "store a checksum of the input, by which those who have the key can recognise the scan.\n"
      "The key is the content of FILE, 16 to 64 bytes. Without this option, no checksum is\n"
      "stored");
}

// The output options that a run and its preview share; `output` is the help of -o.
void add_output_options(const Command& command, Arguments& a, const char* output) {
  Group group(command, "Output");
  group.value("-o,--output", a.output, "FILE", output);
  group.number("--jobs", a.jobs, "N", 0, 1024, "number of threads; 0: one for each core");
  group.flag("--quiet", a.quiet, "print errors only");
}

void add_common_options(const Command& command, Arguments& a, const char* output) {
  add_input_options(command, a);
  add_material_options(command, a);
  add_solid_options(command, a);
  add_stage_options(command, a);
  add_output_options(command, a, output);
}

}  // namespace

void add_mesh_options(const Command& command, Arguments& a) {
  add_common_options(command, a,
                     "the asset to write (.glb), or only its surface (.stl, .ply, .obj)");
  Group group(command, "Output");
  add_asset_options(group, a);
  group.value("--report", a.report, "FILE",
              "write what was done in each slice, and the warnings, as JSON");
  Group diagnostics(command, kDiagnostics);
  diagnostics.value("--dump-stages", a.dump_stages, "FILE",
                    "write the intermediate results of one slice (contour, outline, mesh) as\n"
                    "JSON, for pictures");
  a.dump_slice_option =
      diagnostics.number_if_given("--dump-slice", a.dump_slice, "N", 0, 1'000'000'000,
                                  "the slice of --dump-stages, counted from 0");
}

void add_preview_options(const Command& command, Arguments& a) {
  add_common_options(
      command, a,
      "the preview to write: .png, a picture; or .html, a page with the picture and tables.\n"
      "The tables show areas of the material and numbers of outlines. For a label map, one of\n"
      "the tables shows how many voxels each label has");
  Group(command, "Output")
      .number(
          "--count", a.count, "N", 1, 100,
          "number of slices shown, evenly spread from the first to the last slice with material");
  add_asset_options(Group(command, ""), a);
}

}  // namespace trocar::pipeline
