// SPDX-License-Identifier: GPL-3.0-or-later
// The named peers: what OpenCV alone gives for the same step, measured beside ours in one run.
#pragma once

#include <array>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <vector>

#include "tests/bench/sweep_scan.h"

namespace trocar::pipeline::bench {

/// Milliseconds of f by the wall clock, and of CPU; the median of `repetitions`.
double median_ms(int repetitions, const std::function<void()>& f);
double median_cpu_ms(int repetitions, const std::function<void()>& f);

/// Discs of the radii (pixels), at `offsets` places within a pixel each, as a scanner shows them:
/// every pixel its coverage (sigma_px 0, by 64 x 64 samples) or blurred by a Gaussian edge. The
/// area error of both contour kinds, a row a radius.
nlohmann::json disc_rows(const std::vector<double>& radii_px, double sigma_px, int offsets);

/// simplify() and cv::approxPolyDP (Douglas-Peucker ring by ring) on the same contours: what each
/// breaks, counted by one exact test for both, and milliseconds a slice. A row a tolerance.
nlohmann::json simplifier_rows(const SweepScan& scan, const std::vector<double>& tolerances_px,
                               int repetitions);

/// A folder of PNGs: cv::imread of every file, then the whole path from files to a proved .glb in
/// one thread and in two, verification of that .glb included; and from the DICOM files beside them.
/// Repetitions are interleaved. Times are wall clock and CPU, medians.
Result<nlohmann::json> path_row(const std::filesystem::path& png,
                                const std::filesystem::path& dicom,
                                std::array<double, 3> spacing_mm, double grey_threshold,
                                int repetitions);

}  // namespace trocar::pipeline::bench
