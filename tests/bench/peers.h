// SPDX-License-Identifier: GPL-3.0-or-later
// The same steps by OpenCV alone, measured beside ours in one run.
#pragma once

#include <array>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <vector>

#include "tests/bench/sweep_scan.h"

namespace trocar::pipeline::bench {

/// Wall clock and CPU time of f in ms; medians of `repetitions`.
double median_ms(int repetitions, const std::function<void()>& f);
double median_cpu_ms(int repetitions, const std::function<void()>& f);

/// Images of discs of the given radii (pixels), each at `offsets` places within a pixel: a pixel's
/// value is its coverage (sigma_px 0, by 64 x 64 samples) or a Gaussian edge. The area error of
/// both contour kinds, a row for each radius.
nlohmann::json disc_rows(const std::vector<double>& radii_px, double sigma_px, int offsets);

/// simplify() and cv::approxPolyDP (Douglas-Peucker, ring by ring) on the same contours: the
/// numbers of collapsed and crossing rings, by the same exact test, and milliseconds per slice. A
/// row for each tolerance.
nlohmann::json simplifier_rows(const SweepScan& scan, const std::vector<double>& tolerances_px,
                               int repetitions);

/// A folder of PNGs: cv::imread of every file, then the whole path from files to a verified .glb,
/// with one thread and with two; and the same from the DICOM files beside them. Repetitions are
/// interleaved. Wall clock and CPU times, medians.
Result<nlohmann::json> path_row(const std::filesystem::path& png,
                                const std::filesystem::path& dicom,
                                std::array<double, 3> spacing_mm, double grey_threshold,
                                int repetitions);

}  // namespace trocar::pipeline::bench
