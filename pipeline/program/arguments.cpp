// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/program/arguments.h"

#include "formats/asset/asset.h"
#include "formats/base/command_line.h"
#include "formats/base/option_range.h"
#include "pipeline/program/presets.h"

namespace trocar::pipeline {
namespace {

// The options of one topic of the help.
class Group {
 public:
  Group(CLI::App& app, const char* name) : app_(app), name_(name) {}

  // A number within a range. The help shows `unit` after the option's name.
  template <typename Number>
  CLI::Option* number(const char* name, Number& value, const char* unit, Number low, Number high,
                      const char* help) {
    return app_.add_option(name, value, help)
        ->type_name(unit)
        ->capture_default_str()
        ->check(option_range(low, high).description(""))
        ->group(name_);
  }
  // An option without a default. The help shows `form`, the form of its value.
  template <typename Value>
  CLI::Option* value(const char* name, Value& value, const char* form, const char* help) {
    return app_.add_option(name, value, help)->type_name(form)->group(name_);
  }
  CLI::Option* choice(const char* name, std::string& value, std::vector<std::string> words,
                      const char* help) {
    return app_.add_option(name, value, help)->check(CLI::IsMember(std::move(words)))->group(name_);
  }
  void flag(const char* name, bool& value, const char* help) {
    app_.add_flag(name, value, help)->group(name_);
  }

 private:
  CLI::App& app_;
  const char* name_;
};

void add_input_options(CLI::App& app, Arguments& a) {
  app.add_option("INPUT", a.inputs, "the scan");
  Group group(app, "Input");
  group.value("--spacing", a.spacing, "X,Y,Z",
              "pixel size in x and in y, and slice spacing, in mm; for input that states none");
  group.value("--slices", a.slices, "A:B",
              "mesh only the slices A to B, both included, counted from 0");
  group.value("--crop", a.crop, "X0:X1,Y0:Y1",
              "mesh only the columns X0 to X1 and rows Y0 to Y1, all included, counted from 0");
  group.value("--series", a.series, "UID",
              "mesh this one of several series: its UID, number or description");
  a.volume_given =
      group
          .value("--volume", a.volume, "N",
                 "for a NIfTI file with several volumes (4D): the one to mesh, counted from 0")
          ->check(option_range(0, 1'000'000'000).description(""));
  group.flag("--any-modality", a.any_modality,
             "accept DICOM images other than CT; their values are not HU (Hounsfield units)");
  a.axis_given =
      group.choice("--axis", a.axis, {"axial", "transverse", "coronal", "sagittal"},
                   "direction of the slices (transverse means axial). Default: axial for a NIfTI\n"
                   "file, and the slices as stored for every other volume");
  group.value("--hu", a.hu, "CT",
              "with --labels: the CT with the same voxels as the label map; gives the labels' HU");
}

void add_material_options(CLI::App& app, Arguments& a) {
  Group group(app, "Material");
  std::vector<std::string> names;
  for (const Preset& preset : presets())
    names.emplace_back(preset.name);
  group.choice("--preset", a.preset, std::move(names),
               "use this set of options; --explain prints what is in it");
  group.flag("--explain", a.explain, "print the options of --preset, or of all presets");
  a.threshold_given =
      group.number("--threshold", a.threshold, "HU", -1e6, 1e6,
                   "lowest HU that counts as material (226: dense bone, 180: bone of low\n"
                   "density, -300: skin). For images, it is a grey level from 0 to 255");
  a.equalize_given = group.number(
      "--equalize", a.equalize, "LEVEL", 0.0, 255.0,
      "instead of --threshold: equalise the histogram of grey levels, then apply this\n"
      "threshold from 0 to 255. Without the option, no histogram is equalised");
  a.labels_given =
      group
          .value("--labels", a.labels, "L",
                 "mesh these labels of a label map, whose voxels hold the numbers of structures:\n"
                 "L, A-B, several of these, or all. Each label becomes one material; 20+21 joins\n"
                 "two labels to one material")
          ->allow_extra_args(false);
  group.value("--names", a.names, "FILE",
              "names of the labels: a JSON file such as {\"20\": \"L1\"}, or a table that\n"
              "the program knows: 'verse' or 'totalsegmentator'");
  group.number("--min-region", a.min_region_mm2, "MM2", 0.0, 1e12,
               "in each slice, drop islands and fill holes with less than this area, mm^2");
  group.flag("--keep-table", a.keep_table,
             "mesh the scanner's table, too. Without this option, the table is left out if it\n"
             "is separate from the patient's bone");
}

// Options of solid_bone.h.
void add_solid_options(CLI::App& app, Arguments& a) {
  Group group(app, "Solid bone");
  group.value("--fill", a.fill, "MM2",
              "fill marrow and whatever else bone encloses in at least two of the axial, coronal\n"
              "and sagittal planes; canals stay open. MM2 is the largest area in a plane that is\n"
              "filled, in mm^2. With --fill all there is no limit");
  group.number("--close", a.close_mm, "MM", 0.0, 100.0,
               "with --fill: a gap in bone counts as closed if it is at most twice this wide, mm");
  group.number("--min-volume", a.min_volume_mm3, "MM3", 0.0, 1e12,
               "drop connected components (separate pieces) of less than this volume, mm^3;\n"
               "done before --fill");
  group
      .choice("--keep", a.keep, {"all", "column"},
              "with --fill. all: keep all bone; column: keep the spinal column alone, without\n"
              "vessels full of contrast medium, and with ribs cut off 75 mm from the spinal canal")
      ->capture_default_str();
  group.number("--largest", a.largest, "N", 0, 1'000'000,
               "keep the N largest connected components; 0: keep all");
  group
      .value("--seed", a.seeds, "X,Y,Z",
             "keep the material connected to this point (mm in DICOM's patient coordinates,\n"
             "LPS). Further points mark neighbouring parts, which are cut off from the part\n"
             "around the first point")
      ->allow_extra_args(false);
  group.value("--mask", a.mask, "LABELS.nii.gz:L[,L]",
              "keep only the material within 1.5 mm of the labels L of this label map");
}

void add_stage_options(CLI::App& app, Arguments& a) {
  Group group(app, "Mesh");
  group
      .choice("--contour", a.contour, {"subpixel", "pixel"},
              "subpixel: the border of the material runs between pixels, where the value is the\n"
              "threshold; pixel: it is a chain of pixel centres")
      ->capture_default_str();
  group
      .choice("--simplify", a.simplify, {"area", "dp"},
              "how outlines are simplified. area: edges collapse, and the area is kept; dp: by\n"
              "the method of Douglas and Peucker")
      ->capture_default_str();
  group.number("--tolerance", a.tolerance_mm, "MM", 0.0, 1e4,
               "largest distance of the simplified outline from the contour, mm");
  group.number("--min-angle", a.min_angle_deg, "DEG", 0.0, 60.0,
               "smallest angle of a triangle, degrees");
  a.area_given = group.number("--max-area", a.max_area_mm2, "MM2", 1e-6, 1e12,
                              "largest area of a triangle, mm^2");
  a.area_px_given = group
                        .value("--max-area-px", a.max_area_px2, "PX2",
                               "largest area of a triangle in pixels, instead of --max-area")
                        ->check(option_range(1e-6, 1e12).description(""));
  group.number("--grade", a.grade_hu, "HU", 0.0, 1e6,
               "use smaller triangles where HU change by more than this along an edge of\n"
               "a triangle; 0: never");
  group.number("--lattice-bits", a.lattice_bits, "N", kMinLatticeBits, kMaxLatticeBits,
               "precision: all coordinates are multiples of 2^-N mm");
}

// The output options that a run and its preview share; `output` is the help of -o.
void add_output_options(CLI::App& app, Arguments& a, const char* output) {
  Group group(app, "Output");
  group.value("-o,--output", a.output, "FILE", output);
  group.flag("--no-hu", a.no_hu, "leave HU out of the asset");
  group.flag("--surface", a.surface,
             "add a closed surface of the material, for display and for export --surface");
  a.surface_triangles_given = group.number(
      "--surface-triangles", a.surface_triangles, "N", 100, 5'000'000,
      "largest number of triangles of the surface. The surface has more only if it would\n"
      "otherwise intersect itself. Without this option, it also has more than 50000 if it\n"
      "would otherwise be too far from the material");
  group.number("--jobs", a.jobs, "N", 0, 1024, "threads; 0: all cores");
  group.flag("--quiet", a.quiet, "print errors only");
}

void add_common_options(CLI::App& app, Arguments& a, const char* output) {
  add_input_options(app, a);
  add_material_options(app, a);
  add_solid_options(app, a);
  add_stage_options(app, a);
  add_output_options(app, a, output);
}

}  // namespace

void add_mesh_options(CLI::App& app, Arguments& a) {
  add_common_options(app, a, "the asset to write (.glb), or only its surface (.stl, .ply, .obj)");
  Group group(app, "Output");
  group.flag("--lines", a.lines, "also store the outlines as lines, for viewers");
  group.flag("--colour", a.colour,
             "also store HU as colours for viewers, from dark (-200) to light (1848)");
  a.context_given =
      group
          .value("--context", a.context, "[MM]",
                 "also store the HU around the material, for simulated X-ray pictures: one value "
                 "every\n"
                 "MM mm "
                 "(default: 2 to 4, by the size of the scan). In a scan of a head, these HU can\n"
                 "show the patient's face")
          ->expected(0, 1);
  group.value("--input-key", a.input_key, "FILE",
              "store a keyed digest of the input. The key is the content of this file, 16 to 64\n"
              "bytes. Whoever has the key can recognise the scan. Default: no digest");
  group.value("--report", a.report, "FILE", "write a report, slice by slice, as JSON");
  Group diagnostics(app, kDiagnostics);
  diagnostics.value("--dump-stages", a.dump_stages, "FILE",
                    "write the intermediate results of one slice (contour, outline, mesh) as\n"
                    "JSON, for pictures");
  a.dump_slice_given =
      diagnostics
          .value("--dump-slice", a.dump_slice, "N", "the slice of --dump-stages, counted from 0")
          ->check(option_range(0, 1'000'000'000).description(""));
}

void add_preview_options(CLI::App& app, Arguments& a) {
  add_common_options(app, a, "the picture to write (.png, or .html with the numbers as text)");
  Group(app, "Output")
      .number("--count", a.count, "N", 1, 100,
              "number of slices shown, evenly spread over those with material");
}

}  // namespace trocar::pipeline
