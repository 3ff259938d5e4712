// SPDX-License-Identifier: GPL-3.0-or-later
// The surface for display beside VTK's FlyingEdges with quadric decimation to the same number of
// triangles, from the same voxels: CPU time and peak memory, the proof's time apart, and distances.
//
//   surface_bench [--repetitions N] [--large] NAME=SCAN ...
//
// The scan after --large is resampled to 512 x 512 x 350 voxels.
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>
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
#include <cstdio>
#include <ctime>
#include <fstream>
#include <functional>
#include <string>
#include <vector>

#include "pipeline/open/open_stack.h"
#include "pipeline/surface/decimation.h"
#include "pipeline/surface/display_surface.h"
#include "pipeline/surface/isosurface.h"
#include "pipeline/verify/surface_proof.h"

namespace {

using namespace trocar;
using namespace trocar::pipeline;
using Eigen::Vector3d;

struct Figures {
  double cpu_s = 0, proof_s = 0, peak_mb = 0;
  std::size_t isosurface = 0, triangles = 0, intersecting = 0;
  bool closed = false;
  SurfaceDistance distance, left_out;
};

double cpu_s() {
  return static_cast<double>(std::clock()) / CLOCKS_PER_SEC;
}

// Resident memory in MB: VmRSS, or its maximum VmHWM.
double memory_mb(const std::string& key) {
  std::ifstream status("/proc/self/status");
  for (std::string word; status >> word;)
    if (word == key + ":") {
      double kb = 0;
      status >> kb;
      return kb / 1024;
    }
  return 0;
}

// Runs the work in a process of its own. It returns its surface and states CPU times; what it
// needs beyond the voxels is its memory.
Figures measured(const SurfaceVolume& volume, bool with_distance,
                 const std::function<TriangleSurface(Figures&)>& work) {
  int ends[2];
  if (::pipe(ends) != 0) std::abort();
  const pid_t child = ::fork();
  if (child == 0) {
    std::ofstream("/proc/self/clear_refs") << 5;  // resets VmHWM
    const double before = memory_mb("VmRSS");
    Figures out;
    const TriangleSurface surface = work(out);
    if (out.peak_mb == 0) out.peak_mb = memory_mb("VmHWM") - before;
    out.triangles = surface.triangles.size();
    out.closed = bool{check_triangle_surface(surface)};
    if (out.closed) out.intersecting = self_intersecting_triangles(surface)->size();
    if (with_distance) {
      out.distance = distance_from(surface, volume);
      out.left_out = distance_to(surface, volume, points_on_zero(volume));
    }
    if (::write(ends[1], &out, sizeof out) != sizeof out) ::_exit(1);
    ::_exit(0);
  }
  Figures out;
  ::close(ends[1]);
  if (::read(ends[0], &out, sizeof out) != sizeof out) std::fprintf(stderr, "a child has failed\n");
  ::close(ends[0]);
  ::waitpid(child, nullptr, 0);
  return out;
}

// The steps of make_display_surface(), with CPU times.
TriangleSurface ours(const SurfaceVolume& volume, std::size_t triangles, Figures& out) {
  double start = cpu_s();
  const TriangleSurface fine = *isosurface(volume);
  out.isosurface = fine.triangles.size();
  Decimation decimation(fine);
  for (std::size_t undone = 1;; undone *= 2) {
    TriangleSurface surface = decimation.decimated(triangles);
    out.cpu_s += cpu_s() - start;
    out.peak_mb = std::max(out.peak_mb, memory_mb("VmHWM"));
    start = cpu_s();
    const auto bad = *self_intersecting_triangles(surface);
    out.proof_s += cpu_s() - start;
    start = cpu_s();
    if (bad.empty() || !decimation.undo(bad, undone)) return surface;
  }
}

TriangleSurface vtks(const SurfaceVolume& volume, std::size_t triangles, Figures& out) {
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
  const double start = cpu_s();
  vtkNew<vtkFlyingEdges3D> edges;
  edges->SetInputData(image);
  edges->SetValue(0, 0);
  edges->ComputeNormalsOff();
  edges->ComputeScalarsOff();
  edges->Update();
  out.isosurface = static_cast<std::size_t>(edges->GetOutput()->GetNumberOfCells());
  vtkNew<vtkQuadricDecimation> decimation;
  decimation->SetInputData(edges->GetOutput());
  decimation->SetTargetReduction(
      std::max(0.0, 1 - static_cast<double>(triangles) / static_cast<double>(out.isosurface)));
  decimation->Update();
  out.cpu_s = cpu_s() - start;
  out.peak_mb = memory_mb("VmHWM");

  TriangleSurface surface;
  surface.lattice.bits = 10;
  vtkPolyData* made = decimation->GetOutput();
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

// The volume at 512 x 512 x 350 points of its box.
SurfaceVolume resampled(const SurfaceVolume& volume) {
  SurfaceVolume out;
  out.size = {512, 512, 350};
  const Vector3d low = volume.position(0, 0, 0),
                 high = volume.position(volume.size[0] - 1, volume.size[1] - 1, volume.size[2] - 1);
  const Vector3d step = (high - low).cwiseQuotient(Vector3d(511, 511, 349)) * (1 - 1e-9);
  out.u_mm = step.x();
  out.v_mm = step.y();
  out.T_lps_volume = volume.T_lps_volume;
  for (int z = 0; z < out.size[2]; ++z)
    out.origin_mm.emplace_back(low + Vector3d(0, 0, z * step.z()));
  for (int z = 0; z < out.size[2]; ++z)
    for (int y = 0; y < out.size[1]; ++y)
      for (int x = 0; x < out.size[0]; ++x)
        out.values.push_back(static_cast<float>(volume.at(out.position(x, y, z))));
  return out;
}

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

void print(const char* who, const Figures& f) {
  std::printf(
      "  %-6s %8zu of %8zu triangles, %s, %zu intersect; from the surface p50 %.3f p99 %.3f mm, to "
      "it p50 %.3f p99 %.3f mm\n",
      who, f.triangles, f.isosurface,
      f.closed ? "closed and manifold" : "not closed or not manifold", f.intersecting,
      f.distance.p50_mm, f.distance.p99_mm, f.left_out.p50_mm, f.left_out.p99_mm);
}

void compare(const std::string& name, SurfaceVolume volume, int repetitions) {
  // If a value is on the level, FlyingEdges makes triangles without area, at which VTK's
  // decimation ends early.
  for (float& value : volume.values)
    if (value == 0) value = 1e-3F;
  const auto made = make_display_surface(volume, {});
  if (!made) {
    std::printf("%s: %s\n", name.c_str(), made.error().message.c_str());
    return;
  }
  const std::size_t triangles = made->surface.triangles.size();
  std::vector<double> own, peer, proof;
  Figures ours_figures, vtk_figures;
  for (int i = 0; i < repetitions; ++i) {
    const Figures a =
        measured(volume, i == 0, [&](Figures& f) { return ours(volume, triangles, f); });
    const Figures b =
        measured(volume, i == 0, [&](Figures& f) { return vtks(volume, triangles, f); });
    if (i == 0) {
      ours_figures = a;
      vtk_figures = b;
    }
    own.push_back(a.cpu_s);
    proof.push_back(a.proof_s);
    peer.push_back(b.cpu_s);
  }
  std::printf("%s: %d x %d x %d voxels, bound %.3f mm\n", name.c_str(), volume.size[0],
              volume.size[1], volume.size[2], made->bound_mm);
  print("ours", ours_figures);
  print("VTK", vtk_figures);
  std::printf(
      "  CPU %.3f s, VTK %.3f s, ratio %.2f; proof apart %.3f s; peak memory with the voxels %.0f "
      "MB, VTK %.0f MB, ratio %.2f\n",
      median(own), median(peer), median(own) / median(peer), median(proof), ours_figures.peak_mb,
      vtk_figures.peak_mb, ours_figures.peak_mb / vtk_figures.peak_mb);
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
  int repetitions = 3;
  bool large = false;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    if (word == "--repetitions" && i + 1 < argc) {
      repetitions = std::max(1, std::atoi(argv[++i]));
      continue;
    }
    if (word == "--large") {
      large = true;
      continue;
    }
    const std::size_t equals = word.find('=');
    const auto stack = open_stack({word.substr(equals + 1)}, {});
    if (!stack) {
      std::fprintf(stderr, "%s\n", stack.error().message.c_str());
      return 3;
    }
    auto volume = read_surface_volume(**stack, 0, (*stack)->size() - 1, {});
    if (!volume) {
      std::fprintf(stderr, "%s\n", volume.error().message.c_str());
      return 3;
    }
    compare(word.substr(0, equals), large ? resampled(*volume) : std::move(*volume), repetitions);
    large = false;
  }
  return 0;
}
