// SPDX-License-Identifier: GPL-3.0-or-later
// noise_sweep < PLAN.json > ROWS.json: how the time from a slice's pixels to its encoded mesh grows
// with the slice, on images whose outlines fill the whole slice.
//
// PLAN: {"repetitions": 1, "sizes": [512, ..], "textures": ["noise" | "struts" | "grains", ..]}
// A row for each texture and size, of the fastest repetition by CPU time; the stages are in elapsed
// time. Within one repetition every row is measured once, so that a slow minute of the machine
// slows all of them.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <ctime>
#include <fstream>
#include <limits>
#include <string>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/base/json_text.h"
#include "pipeline/base/malloc_tuning.h"
#include "pipeline/scan/mesh_slice.h"
#include "pipeline/scan/report.h"
#include "tests/bench/sweep_main.h"
#include "tests/bench/sweep_scan.h"

namespace {

using namespace trocar;
using namespace trocar::pipeline;
using namespace trocar::pipeline::bench;
using nlohmann::json;

constexpr double kSpacing_mm = 1;

// Independent values of a pixel's place, -0.5 .. 0.5 (splitmix64).
float noise_at(std::uint64_t x, std::uint64_t y) {
  std::uint64_t z = ((y << 32U | x) + 1) * 0x9E3779B97F4A7C15U;
  z = (z ^ (z >> 30U)) * 0xBF58476D1CE4E5B9U;
  z = (z ^ (z >> 27U)) * 0x94D049BB133111EBU;
  return static_cast<float>((z ^ (z >> 31U)) >> 40U) * 0x1p-24F - 0.5F;
}

// The mean over `radius` pixels on either side, along one axis: `step` between neighbours of a
// line, `next` between lines.
void blur(std::vector<float>& values, int size, int radius, std::size_t step, std::size_t next) {
  std::vector<float> line(static_cast<std::size_t>(size));
  for (int k = 0; k < size; ++k) {
    float* const first = &values[static_cast<std::size_t>(k) * next];
    double sum = 0;
    const auto at = [&](int i) {
      return double{first[static_cast<std::size_t>((i + size) % size) * step]};
    };
    for (int i = -radius; i <= radius; ++i)
      sum += at(i);
    for (int i = 0; i < size; ++i) {
      line[static_cast<std::size_t>(i)] = static_cast<float>(sum / (2 * radius + 1));
      sum += at(i + radius + 1) - at(i - radius);
    }
    for (int i = 0; i < size; ++i)
      first[static_cast<std::size_t>(i) * step] = line[static_cast<std::size_t>(i)];
  }
}

// Noise filtered by three boxes along each axis, which is nearly a Gaussian; its deviation is 1.
std::vector<float> filtered(int size, int radius, std::uint64_t seed) {
  std::vector<float> out;
  const auto n = static_cast<std::size_t>(size);
  for (std::size_t y = 0; y < n; ++y)
    for (std::size_t x = 0; x < n; ++x)
      out.push_back(noise_at(x + (seed << 20U), y));
  for (int i = 0; i < 3; ++i) {
    blur(out, size, radius, 1, n);
    blur(out, size, radius, n, 1);
  }
  double squares = 0;
  for (const float v : out)
    squares += double{v} * double{v};
  const auto scale = static_cast<float>(1 / std::sqrt(squares / static_cast<double>(out.size())));
  for (float& v : out)
    v *= scale;
  return out;
}

// Whole HU, as a scanner's: material where the value is positive.
Result<Image> texture(const std::string& kind, int size) {
  constexpr double kContrast_HU = 400;
  const auto n = static_cast<std::size_t>(size);
  std::vector<float> values;
  if (kind == "noise") {
    for (std::size_t i = 0; i < n * n; ++i)
      values.push_back(noise_at(i % n, i / n));
  } else if (kind == "struts") {  // as trabecular bone: a band around the zero of filtered noise
    values = filtered(size, 4, 1);
    const std::vector<float> rough = filtered(size, 1, 2);
    for (std::size_t i = 0; i < values.size(); ++i)
      values[i] = 0.4F - std::abs(values[i] + 0.1F * rough[i]);
  } else if (kind == "grains") {
    values = filtered(size, 2, 3);
    const std::vector<float> large = filtered(size, 12, 4);
    for (std::size_t i = 0; i < values.size(); ++i)
      values[i] += 0.7F * large[i];
  } else {
    return usage("textures: noise, struts or grains, not " + kind);
  }
  for (float& v : values)
    v = static_cast<float>(std::rint(kIso_HU + kContrast_HU * double{v}) + 0.5);
  return Image{size, size, std::move(values)};
}

// The largest resident memory since the last call, or 0.
std::uint64_t peak_rss_since_last() {
  const std::uint64_t peak = peak_rss_bytes();
  std::ofstream("/proc/self/clear_refs") << "5";
  return peak;
}

double cpu_ms() {
  return 1e3 * static_cast<double>(std::clock()) / CLOCKS_PER_SEC;
}

// Time from pixels to the encoded slice, in ms by stage.
Result<json> measured(const MemoryStack& stack) {
  const double start_ms = cpu_ms();
  auto meshed = mesh_slice(stack, 0, {});
  if (!meshed) return meshed.error();
  MeshedMaterial& only = meshed->materials[0];
  LatticeBox box = box_around(only.refined.mesh.vertices);
  const auto grid = asset_grid({}, box);
  if (!grid) return grid.error();
  json row;
  row["rings"] = only.pslg.rings.size();
  std::size_t in_contours = 0, in_outline = 0;
  for (const Ring& ring : only.contours.rings)
    in_contours += ring.size();
  for (const Ring& ring : only.outline.pslg().rings)
    in_outline += ring.size();
  row["contour_vertices"] = in_contours;
  row["outline_vertices"] = in_outline;
  row["vertices"] = only.refined.mesh.vertices.size();
  row["triangles"] = only.refined.mesh.triangles.size();
  const double encode_ms = cpu_ms();
  const SlicePlane& plane = stack.plane(0);
  const auto encoded = encode_slice({0,
                                     plane.z_mm,
                                     plane.T_lps_plane,
                                     {},
                                     std::move(only.refined.mesh),
                                     "{}",
                                     0,
                                     only.hu ? std::move(only.hu->values) : std::vector<float>()},
                                    only.outline, *grid);
  if (!encoded) return encoded.error();
  json ms = meshed->times;
  ms["encode"] = cpu_ms() - encode_ms;
  row["cpu_ms"] = cpu_ms() - start_ms;
  row["ms"] = std::move(ms);
  row["bytes"] = encoded->draco.size();
  return row;
}

Result<json> run(const json& plan) {
  const int repetitions = plan.at("repetitions");
  if (repetitions < 1) return usage("repetitions must be >= 1");
  json rows = json::array();
  for (int i = 0; i < repetitions; ++i) {
    std::size_t at = 0;
    for (const json& kind : plan.at("textures")) {
      for (const json& size : plan.at("sizes")) {
        const int pixels = size.get<int>();
        if (pixels < 32 || pixels > 8192) return usage("sizes: 32 to 8192");
        auto image = texture(kind.get<std::string>(), pixels);
        if (!image) return image.error();
        MemoryStack stack;
        stack.images.push_back(std::move(*image));
        SlicePlane plane;
        plane.spacing_u_mm = plane.spacing_v_mm = kSpacing_mm;
        stack.planes.push_back(plane);
        stack.names.push_back(kind.get<std::string>());
        peak_rss_since_last();
        auto row = measured(stack);
        if (!row) return row.error();
        (*row)["texture"] = kind;
        (*row)["size"] = pixels;
        (*row)["peak_rss_bytes"] = peak_rss_since_last();
        (*row)["us_per_vertex"] =
            1e3 * (*row)["cpu_ms"].get<double>() / std::max(1.0, (*row)["vertices"].get<double>());
        if (at == rows.size()) {
          rows.push_back(std::move(*row));
        } else if ((*row)["cpu_ms"] < rows[at]["cpu_ms"]) {
          rows[at] = std::move(*row);
        }
        ++at;
      }
    }
  }
  return json{{"rows", std::move(rows)}};
}

}  // namespace

int main() {
  trocar::pipeline::keep_freed_memory();
  return trocar::test::sweep_main("noise_sweep", run);
}
