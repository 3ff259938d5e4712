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
              "pixel size in x and y, and slice spacing, mm, if the input has none");
  group.value("--slices", a.slices, "A:B", "first and last slice to mesh, counted from 0");
  group.value("--crop", a.crop, "X0:X1,Y0:Y1",
              "first and last column, then first and last row, counted from 0");
  group.value("--series", a.series, "UID", "UID, number or description of one of several series");
  a.volume_given = group
                       .value("--volume", a.volume, "N",
                              "volume of a NIfTI with a fourth dimension, counted from 0")
                       ->check(option_range(0, 1'000'000'000).description(""));
  group.flag("--any-modality", a.any_modality,
             "accept DICOM images other than CT; their values are not HU");
  a.axis_given =
      group.choice("--axis", a.axis, {"axial", "transverse", "coronal", "sagittal"},
                   "slice direction of a volume (transverse is another word for axial); default:\n"
                   "axial for a NIfTI file, as stored for all other volumes");
  group.value("--hu", a.hu, "CT",
              "CT with the same voxels as the label map, for the labels' mean HU");
}

void add_material_options(CLI::App& app, Arguments& a) {
  Group group(app, "Material");
  std::vector<std::string> names;
  for (const Preset& preset : presets())
    names.emplace_back(preset.name);
  group.choice("--preset", a.preset, std::move(names), "a set of options; --explain prints them");
  group.flag("--explain", a.explain, "print the options of --preset, or of all presets");
  a.threshold_given = group.number("--threshold", a.threshold, "HU", -1e6, 1e6,
                                   "lowest HU of the material (226 dense bone, 180 bone of low\n"
                                   "density, -300 skin); for images a grey level of 0..255");
  a.equalize_given =
      group.number("--equalize", a.equalize, "LEVEL", 0.0, 255.0,
                   "instead of --threshold: equalise the histogram, then apply a threshold of\n"
                   "0..255; only if the option is given");
  a.labels_given = group
                       .value("--labels", a.labels, "L",
                              "labels of a label map, one material each: L, A-B, several, or all;\n"
                              "20+21 joins two labels to one material")
                       ->allow_extra_args(false);
  group.value("--names", a.names, "FILE",
              "names of the labels: a JSON file such as {\"20\": \"L1\"}, or a table that\n"
              "the program knows: 'verse' or 'totalsegmentator'");
  group.number("--min-region", a.min_region_mm2, "MM2", 0.0, 1e12,
               "drop smaller islands and fill smaller holes, mm^2");
  group.flag("--keep-table", a.keep_table,
             "mesh the scanner's table, too; without this option it is left out if it\nis separate "
             "from the patient's bone");
}

// Options of solid_bone.h.
void add_solid_options(CLI::App& app, Arguments& a) {
  Group group(app, "Solid bone");
  group.value("--fill", a.fill, "MM2",
              "fill regions that bone encloses in at least two of the axial, coronal\n"
              "and sagittal planes, so canals stay open. MM2 is the largest area of a\n"
              "region in such a plane that is filled; the word all sets no limit");
  group.number("--close", a.close_mm, "MM", 0.0, 100.0,
               "with --fill: close gaps in bone whose width is at most twice this length, mm");
  group.number("--min-volume", a.min_volume_mm3, "MM3", 0.0, 1e12,
               "drop smaller connected components, mm^3; done before --fill");
  group
      .choice("--keep", a.keep, {"all", "column"},
              "with --fill: keep all bone, or the spinal column without contrast-\n"
              "filled vessels; ribs are cut off 75 mm from the canal")
      ->capture_default_str();
  group.number("--largest", a.largest, "N", 0, 1'000'000,
               "keep the N largest connected components; 0 keeps all");
  group
      .value("--seed", a.seeds, "X,Y,Z",
             "keep the material connected to this point (LPS, mm). Further points mark\n"
             "neighbouring parts, which are cut off from the part around the first point")
      ->allow_extra_args(false);
  group.value("--mask", a.mask, "LABELS.nii.gz:L[,L]",
              "keep the material within 1.5 mm of these labels");
}

void add_stage_options(CLI::App& app, Arguments& a) {
  Group group(app, "Mesh");
  group
      .choice("--contour", a.contour, {"subpixel", "pixel"},
              "iso-contour between the pixels, or chains of pixels")
      ->capture_default_str();
  group
      .choice("--simplify", a.simplify, {"area", "dp"},
              "area-preserving edge collapse, or Douglas-Peucker")
      ->capture_default_str();
  group.number("--tolerance", a.tolerance_mm, "MM", 0.0, 1e4,
               "largest distance of the outline from the contour, mm");
  group.number("--min-angle", a.min_angle_deg, "DEG", 0.0, 60.0,
               "smallest angle of a triangle, degrees");
  a.area_given = group.number("--max-area", a.max_area_mm2, "MM2", 1e-6, 1e12,
                              "largest area of a triangle, mm^2");
  a.area_px_given = group
                        .value("--max-area-px", a.max_area_px2, "PX2",
                               "largest area of a triangle in pixels, instead of --max-area")
                        ->check(option_range(1e-6, 1e12).description(""));
  group.number("--grade", a.grade_hu, "HU", 0.0, 1e6,
               "refine where HU change by more than this along an edge; 0: never");
  group.number("--lattice-bits", a.lattice_bits, "N", kMinLatticeBits, kMaxLatticeBits,
               "coordinates are multiples of 2^-N mm");
}

// The output options that a run and its preview share; `output` is the help of -o.
void add_output_options(CLI::App& app, Arguments& a, const char* output) {
  Group group(app, "Output");
  group.value("-o,--output", a.output, "FILE", output);
  group.flag("--no-hu", a.no_hu, "leave HU out of the asset");
  group.flag("--surface", a.surface, "add a closed surface for display; see export --surface");
  a.surface_triangles_given = group.number(
      "--surface-triangles", a.surface_triangles, "N", 100, 5'000'000,
      "largest number of triangles of the surface. It is exceeded only if the surface\n"
      "would otherwise intersect itself. Without this option, 50000 is a target, and\n"
      "is also exceeded where the surface would be too far from the material");
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
             "also store HU as colours, -200 dark to 1848 light, for viewers");
  a.context_given =
      group
          .value("--context", a.context, "[MM]",
                 "also store the HU of everything around the material, every MM mm\n"
                 "(default: 2 to 4, by the size of the scan), for X-ray pictures. In a\n"
                 "scan of a head these HU can show the patient's face")
          ->expected(0, 1);
  group.value("--input-key", a.input_key, "FILE",
              "key of 16 to 64 bytes: store a keyed digest of the input, by which\n"
              "holders of the key can recognise the scan; default: no digest");
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
