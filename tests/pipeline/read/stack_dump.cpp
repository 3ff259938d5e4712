// SPDX-License-Identifier: GPL-3.0-or-later
// stack_dump OUT AXIS SPACING INPUT...: prints what the readers give, for tests in Python: every
// slice's values as float32 in OUT, the rest as JSON on stdout. AXIS is transverse, coronal,
// sagittal, or labels: as stored, of a label map. SPACING is X,Y,Z in mm, or - for none. Errors and
// exit codes are those of trocar-mesh.
#include <array>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <nlohmann/json.hpp>

#include "pipeline/open/open_stack.h"
#include "pipeline/read/slice_stack.h"

int main(int argc, char** argv) {
  using namespace trocar::pipeline;
  const auto fail = [](const trocar::Error& error) {
    std::cerr << error.message << '\n';
    return static_cast<int>(error.code);
  };
  if (argc < 5) return fail(trocar::usage("stack_dump OUT AXIS SPACING INPUT..."));
  OpenOptions options;
  const std::string axis = argv[2];
  if (axis == "coronal") options.axis = SliceAxis::kCoronal;
  if (axis == "sagittal") options.axis = SliceAxis::kSagittal;
  options.as_labels = axis == "labels";
  std::array<double, 3> mm{};
  if (std::sscanf(argv[3], "%lf,%lf,%lf", &mm[0], &mm[1], &mm[2]) == 3) options.spacing_mm = mm;
  const auto stack = open_stack({argv + 4, argv + argc}, options);
  if (!stack) return fail(stack.error());
  std::ofstream out(argv[1], std::ios::binary);
  nlohmann::json slices = nlohmann::json::array(), warnings = nlohmann::json::array();
  for (int i = 0; i < (*stack)->size(); ++i) {
    const auto image = (*stack)->read(i);
    if (!image) return fail(image.error());
    out.write(reinterpret_cast<const char*>(image->values.data()),
              static_cast<std::streamsize>(image->values.size() * sizeof(float)));
    const SlicePlane& p = (*stack)->plane(i);
    const Eigen::Vector3d far =
        p.T_lps_plane * Eigen::Vector3d(((*stack)->width() - 1) * p.spacing_u_mm,
                                        ((*stack)->height() - 1) * p.spacing_v_mm, 0);
    const Eigen::Vector3d near = p.T_lps_plane.translation();
    slices.push_back({{"name", (*stack)->name(i)},
                      {"z_mm", p.z_mm},
                      {"first", {near.x(), near.y(), near.z()}},
                      {"last", {far.x(), far.y(), far.z()}}});
  }
  for (const Warning& w : (*stack)->warnings)
    warnings.push_back({{"code", w.code}, {"where", w.where}, {"sentence", w.sentence}});
  std::cout << nlohmann::json{{"width", (*stack)->width()},
                              {"height", (*stack)->height()},
                              {"slices", slices},
                              {"warnings", warnings}}
            << '\n';
}
