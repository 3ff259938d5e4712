// SPDX-License-Identifier: GPL-3.0-or-later
// Holds the input of refinement: the segments of the outline and the angles between them.
// Near an acute corner, this header also determines where segments are split: on shells,
// which are concentric circles around the corner. The two segments that meet at the corner
// are thus split at equal distances from it, and their parts do not encroach upon each other
// (Ruppert, 1995; Shewchuk).
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "formats/geometry/segment_split.h"
#include "pipeline/contour/segment_grid.h"
#include "pipeline/triangulation/refinement.h"

namespace trocar::pipeline {

class RefinementOutline {
 public:
  static constexpr std::uint32_t kNoCorner = 0xffffffff, kNoTwin = 0xffffffff;

  /// Removes all segments and keeps the memory. `vertices` is the number of input vertices.
  void clear(std::size_t vertices);
  /// Adds a segment between two input vertices and returns its number. Numbers count from 0.
  std::uint32_t add(std::uint32_t from, std::uint32_t to);
  /// Measures the angles between the segments. Call it once, after the last add().
  void close(const std::vector<LatticePoint>& points);

  /// Finds the segments that two regions share (twins). Call it after close(). Without this call no
  /// segment has a twin.
  void find_twins(const std::vector<LatticePoint>& points);
  /// The segment that coincides with this one in the opposite direction, or kNoTwin.
  std::uint32_t twin(std::uint32_t segment) const {
    return twins_.empty() ? kNoTwin : twins_[segment];
  }

  /// Finds the loops that the segments form. lost_of_loop() keeps the area by which splits reduce
  /// each loop. If regions share borders, a loop is divided where the region on its other side
  /// changes. Each part then counts as a loop, and has only one region, or only the void (the area
  /// without material), on its other side.
  void find_loops();
  /// Prepares has_clearance().
  void start_clearance(const std::vector<LatticePoint>& points);
  /// Returns true if no other part of the outline can meet this segment even after splits. When the
  /// points of splits are rounded, they may move by up to one step to the void's side, and by up to
  /// three steps to the material's side. Valid after start_clearance(). The answer is computed when
  /// it is first needed, because most segments are never split.
  bool has_clearance(std::uint32_t segment) {
    if (clearance_[segment] == Clearance::kUnknown) [[unlikely]]
      find_clearance(segment);
    return clearance_[segment] == Clearance::kYes;
  }
  /// Twice the area, in steps^2, by which splits have reduced the segment's loop so far; negative
  /// if the loop has grown. The caller adds the effect of each split. Valid after find_loops().
  std::int64_t& lost_of_loop(std::uint32_t segment) { return lost_[loop_[segment]]; }

  const std::vector<Refined::Segment>& segments() const { return segments_; }
  /// The angle in the material at an input vertex, in degrees. 360 stands for all angles of 90
  /// degrees or more, because they play no role in refinement.
  double angle_deg(std::uint32_t vertex) const { return angle_deg_[vertex]; }

  /// Returns the corner at which the segments s and t meet under an angle below 60 degrees in the
  /// material. Returns kNoCorner if there is no such corner, or if s or t is negative. (A negative
  /// number is no segment, as in VertexOrigin.)
  std::uint32_t small_corner(std::int32_t s, std::int32_t t) const {
    return s < 0 || t < 0 || s == t ? kNoCorner : small_corner_of_two(s, t);
  }

  /// Returns true if a segment starts or ends in an acute corner (below kAcuteCorner_deg of
  /// segment_split.h). The segment's splits must then lie on shells. If two regions share the
  /// segment, it suffices that the corner is acute in one of them.
  bool has_shells(std::uint32_t segment) const {
    return is_acute_from(segment) || is_acute_to(segment);
  }
  /// The position at which to split the edge ab of a segment that has shells, as a fraction of the
  /// way from a to b. The position lies on a shell around the segment's acute corner. If both ends
  /// of the segment are acute corners, the corner nearer to the edge is chosen. The two segments
  /// that meet in this corner are thus split at equal distances from it.
  double shell_fraction(std::uint32_t segment, LatticePoint a, LatticePoint b,
                        const std::vector<LatticePoint>& points) const;

 private:
  bool is_acute(std::uint32_t vertex) const { return angle_deg_[vertex] < kAcuteCorner_deg; }
  bool is_acute_from(std::uint32_t segment) const {
    return is_acute(segments_[segment].from) ||
           (twin(segment) != kNoTwin && is_acute(segments_[twin(segment)].to));
  }
  bool is_acute_to(std::uint32_t segment) const {
    return is_acute(segments_[segment].to) ||
           (twin(segment) != kNoTwin && is_acute(segments_[twin(segment)].from));
  }
  bool is_one_loop_with_previous(std::uint32_t segment) const;
  std::uint32_t small_corner_of_two(std::int32_t s, std::int32_t t) const;
  void find_clearance(std::uint32_t segment);

  std::vector<Refined::Segment> segments_;
  std::vector<std::int32_t> into_;  // for each input vertex: the segment that ends there
  std::vector<std::uint32_t> twins_;
  std::vector<double> angle_deg_;
  enum class Clearance : std::uint8_t { kUnknown, kNo, kYes };
  std::vector<Clearance> clearance_;
  std::vector<std::uint32_t> next_;   // for each segment: the one that starts at its end
  std::vector<LatticeSegment> ends_;  // for each segment: its ends, for has_clearance()
  std::optional<SegmentGrid> grid_;   // grid of ends_, made when has_clearance() first needs it
  std::vector<std::uint32_t> loop_;   // for each segment: its loop
  std::vector<std::int64_t> lost_;    // for each loop: see lost_of_loop()
};

}  // namespace trocar::pipeline
