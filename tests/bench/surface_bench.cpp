// SPDX-License-Identifier: GPL-3.0-or-later
// surface_bench NAME=SCAN...: the surface for display, with its proof, beside VTK's FlyingEdges with
// quadric decimation to the same number of triangles, from the same voxels.
#include <vtkCellArray.h>
#include <vtkFloatArray.h>
#include <vtkFlyingEdges3D.h>
#include <vtkIdList.h>
#include <vtkImageData.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkPolyData.h>
#include <vtkQuadricDecimation.h>

#include <algorithm>
#include <cmath>

#include "pipeline/open/open_stack.h"
#include "pipeline/surface/cgal_verification.h"
#include "pipeline/surface/display_surface.h"
#include "pipeline/surface/isosurface.h"
#include "tests/bench/bench.h"

namespace trocar::bench {
namespace {

using namespace trocar::pipeline;
using Eigen::Vector3d;

/// The steps of make_display_surface().
TriangleSurface ours(const SurfaceVolume& volume, std::size_t triangles) {
  const TriangleSurface fine = take(isosurface(volume));
  Decimation decimation(fine);
  for (std::size_t undone = 1;; undone *= 2) {
    TriangleSurface surface = decimation.decimated(triangles);
    const auto bad = take(self_intersecting_triangles(surface));
    if (bad.empty() || !decimation.undo(bad, undone)) return surface;
  }
}

/// FlyingEdges and quadric decimation, from the same voxels.
vtkNew<vtkQuadricDecimation> by_vtk(const SurfaceVolume& volume, std::size_t triangles) {
  vtkNew<vtkImageData> image;
  const auto [u, v, w] = volume.voxel_mm();
  const Vector3d origin = volume.origin_mm[0];
  image->SetDimensions(volume.size.data());
  image->SetSpacing(u, v, w);
  image->SetOrigin(origin.x(), origin.y(), origin.z());
  vtkNew<vtkFloatArray> values;
  values->SetArray(const_cast<float*>(volume.values.data()),
                   static_cast<vtkIdType>(volume.values.size()), 1);
  image->GetPointData()->SetScalars(values);
  vtkNew<vtkFlyingEdges3D> edges;
  edges->SetInputData(image);
  edges->SetValue(0, 0);
  edges->ComputeNormalsOff();
  edges->ComputeScalarsOff();
  edges->Update();
  const auto all = static_cast<double>(edges->GetOutput()->GetNumberOfCells());
  vtkNew<vtkQuadricDecimation> decimation;
  decimation->SetInputData(edges->GetOutput());
  decimation->SetTargetReduction(std::max(0.0, 1 - static_cast<double>(triangles) / all));
  decimation->Update();
  return decimation;
}

/// On a lattice of 2^-10 mm, facing outwards.
TriangleSurface surface_of(vtkPolyData* made, const SurfaceVolume& volume) {
  TriangleSurface surface;
  surface.lattice.bits = 10;
  for (vtkIdType i = 0; i < made->GetNumberOfPoints(); ++i) {
    double p[3];
    made->GetPoint(i, p);
    const Vector3d q = volume.T_lps_volume * Vector3d(p[0], p[1], p[2]) / surface.lattice.step_mm();
    SpacePoint point{};
    for (int k = 0; k < 3; ++k)
      point.at(static_cast<std::size_t>(k)) = static_cast<std::int32_t>(std::lround(q[k]));
    surface.vertices.push_back(point);
  }
  vtkNew<vtkIdList> ids;
  for (vtkIdType i = 0; i < made->GetNumberOfCells(); ++i) {
    made->GetCellPoints(i, ids);
    std::array<std::uint32_t, 3> t{};
    for (std::size_t k = 0; k < 3; ++k)
      t.at(k) = static_cast<std::uint32_t>(ids->GetId(static_cast<vtkIdType>(k)));
    surface.triangles.push_back(t);
  }
  if (enclosed_volume(surface) < 0)
    for (auto& t : surface.triangles)
      std::swap(t[0], t[1]);
  return surface;
}

Counters counters_of(const TriangleSurface& surface, const SurfaceVolume& volume) {
  const bool closed{check_triangle_surface(surface)};
  const SurfaceDistance from = distance_from(surface, volume),
                        to = distance_to(surface, volume, points_on_zero(volume));
  return {{"error_p99_mm", std::max(from.p99_mm, to.p99_mm)},
          {"error_p50_mm", std::max(from.p50_mm, to.p50_mm)},
          {"triangles", static_cast<double>(surface.triangles.size())},
          {"closed", closed ? 1.0 : 0.0},
          {"intersecting",
           closed ? static_cast<double>(take(self_intersecting_triangles(surface)).size()) : -1}};
}

void add_all(const std::vector<Input>& inputs) {
  for (const Input& input : inputs) {
    const auto stack = take(open_stack({input.file}, {}));
    const auto volume = std::make_shared<SurfaceVolume>(
        take(read_surface_volume(*stack, 0, stack->size() - 1, {})));
    // At a value on the level, FlyingEdges makes triangles without area, at which VTK's decimation
    // ends early.
    std::replace(volume->values.begin(), volume->values.end(), 0.0F, 1e-3F);
    const std::size_t triangles = take(make_display_surface(*volume, {})).surface.triangles.size();
    add(
        "surface/" + input.name + "/trocar", benchmark::kMillisecond,
        [=] { benchmark::DoNotOptimize(ours(*volume, triangles)); },
        [=] {
          Counters out = counters_of(ours(*volume, triangles), *volume);
          check(out["closed"] == 1 && out["intersecting"] == 0, "the surface is not proved");
          return out;
        });
    add(
        "surface/" + input.name + "/peer-VTK", benchmark::kMillisecond,
        [=] { benchmark::DoNotOptimize(by_vtk(*volume, triangles)); },
        [=] {
          return counters_of(surface_of(by_vtk(*volume, triangles)->GetOutput(), *volume), *volume);
        });
  }
}

}  // namespace
}  // namespace trocar::bench

int main(int argc, char** argv) {
  return trocar::bench::bench_main(argc, argv, trocar::bench::add_all);
}
