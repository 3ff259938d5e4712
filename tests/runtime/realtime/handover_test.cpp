// SPDX-License-Identifier: Apache-2.0
// What stands between the haptic thread and the others: the lock-free hand-overs under two
// threads, the remesher, the histogram of durations, and the realtime thread.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <random>
#include <thread>

#include "runtime/realtime/histogram.h"
#include "runtime/realtime/overwriting_ring.h"
#include "runtime/realtime/realtime_thread.h"
#include "runtime/realtime/spsc_queue.h"
#include "runtime/realtime/triple_buffer.h"
#include "runtime/session/workers.h"
#include "tests/support/sheet_fixture.h"

namespace trocar::runtime {
namespace {

TEST(Remesher, ServesAndPublishesFromItsThread) {
  const Scene scene = test::descent_scene({0.12, 0.14}, 0.2, 0.1, 0.015);
  Remesher remesher(*place_slices(scene, test::square_asset(2), "a"));
  const std::int64_t whole = doubled_area(to_slice_mesh(remesher.current(0)->mesh));
  remesher.start();
  std::int64_t removed = 0;
  for (std::uint32_t i = 0; i < 20; ++i) {
    CutRequest request;
    request.sheet = static_cast<std::int32_t>(i % 2);
    request.cut = i / 2 + 1;
    Pose pose;
    pose.p_m = {-0.015 + 0.003 * (request.cut - 1), 0.001 * (i % 7),
                0.1};  // they overlap one another
    const Sheet* before = remesher.current(request.sheet);
    request.outline =
        outline_on_lattice(make_tool(scene.tool), pose, before->transform, before->z_m);
    ASSERT_TRUE(remesher.request(request));
    // As the haptic thread does: look until the new one is there, use the old one meanwhile.
    const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(20);
    while (remesher.current(request.sheet)->cuts < request.cut) {
      ASSERT_LT(std::chrono::steady_clock::now(), until);
      ASSERT_GT(remesher.current(request.sheet)->mesh.triangles_in_use(), 0U);
    }
  }
  remesher.stop();
  for (const CutRecord& record : remesher.records()) {
    ASSERT_FALSE(record.error) << record.error->message;
    if (record.request.sheet == 0) removed += record.cut.doubled_area_removed;
  }
  EXPECT_EQ(remesher.records().size(), 20U);
  EXPECT_EQ(doubled_area(to_slice_mesh(remesher.last_version(0).mesh)), whole - removed);
  EXPECT_EQ(doubled_area(to_slice_mesh(remesher.first_version(0).mesh)), whole);
}

class TwoReplicas : public testing::Test {
 protected:
  TwoReplicas() {
    scene_ = test::descent_scene({0.12, 0.14}, 0.2, 0.1, 0.015);
    remesher_ = std::make_unique<Remesher>(*place_slices(scene_, test::square_asset(2), "a"));
  }
  void ask(std::int32_t sheet, std::uint32_t cut) {
    Pose pose;
    pose.p_m = {-0.015 + 0.002 * cut, 0, 0.1};
    const Sheet& placed = remesher_->first_version(static_cast<std::size_t>(sheet));
    ASSERT_TRUE(remesher_->request(
        {sheet, cut,
         outline_on_lattice(make_tool(scene_.tool), pose, placed.transform, placed.z_m)}));
  }
  Scene scene_;
  std::unique_ptr<Remesher> remesher_;
};

TEST_F(TwoReplicas, TheOlderIsNotWrittenBeforeTheReaderHasLetItGo) {
  const Sheet* const first = remesher_->current(0);
  const SheetMesh as_it_was = first->mesh;
  ask(0, 1);
  ask(0, 2);
  remesher_->serve();
  EXPECT_EQ(remesher_->records().size(), 1U) << "one version that is not published at the most";
  EXPECT_EQ(remesher_->current(0), first);
  EXPECT_TRUE(remesher_->publish_next());
  EXPECT_FALSE(remesher_->publish_next());
  for (int i = 0; i < 3; ++i)
    remesher_->serve();
  EXPECT_EQ(remesher_->records().size(), 1U) << "the reader has not looked yet";
  EXPECT_EQ(first->mesh.triangles, as_it_was.triangles);
  EXPECT_EQ(first->mesh.vertices, as_it_was.vertices);
  const Sheet* const second = remesher_->current(0);
  EXPECT_NE(second, first);
  EXPECT_EQ(second->cuts, 1U);
  remesher_->serve();
  ASSERT_EQ(remesher_->records().size(), 2U);
  EXPECT_TRUE(remesher_->publish_next());
  EXPECT_EQ(remesher_->current(0), first) << "two replicas, not more";
  EXPECT_EQ(first->cuts, 2U);
  for (const Sheet* sheet : {first, second})
    EXPECT_TRUE(check_sheet_mesh(sheet->mesh));
  std::int64_t removed = 0;
  for (const CutRecord& record : remesher_->records()) {
    ASSERT_FALSE(record.error);
    removed += record.cut.doubled_area_removed;
    std::int64_t of_hole = 0;
    for (const Ring& ring : remesher_->hole(record))
      of_hole += doubled_area(ring);
    EXPECT_EQ(of_hole, record.cut.doubled_area_removed);
  }
  EXPECT_EQ(doubled_area(to_slice_mesh(as_it_was)) - doubled_area(to_slice_mesh(first->mesh)),
            removed);
}

TEST_F(TwoReplicas, SheetsDoNotWaitForOneAnotherAndStopServesWhatIsLeft) {
  ask(0, 1);
  ask(1, 1);
  remesher_->serve();
  EXPECT_EQ(remesher_->records().size(), 2U);
  ask(1, 2);
  ask(1, 3);
  ask(0, 2);
  remesher_->stop();
  EXPECT_EQ(remesher_->records().size(), 5U);
  EXPECT_EQ(remesher_->current(0)->cuts, 2U);
  EXPECT_EQ(remesher_->current(1)->cuts, 3U);
}

TEST_F(TwoReplicas, AFailedCutIsRecordedAndTheSheetStaysAsItIs) {
  const SheetMesh as_it_was = remesher_->current(0)->mesh;
  CutRequest not_a_tool;
  not_a_tool.sheet = 0;
  not_a_tool.cut = 1;
  ASSERT_TRUE(remesher_->request(not_a_tool));
  ask(0, 2);
  remesher_->serve();
  EXPECT_FALSE(remesher_->publish_next());
  ASSERT_EQ(remesher_->records().size(), 2U);
  for (const CutRecord& record : remesher_->records())
    EXPECT_TRUE(record.error);
  EXPECT_EQ(remesher_->current(0)->cuts, 0U);
  EXPECT_EQ(remesher_->current(0)->mesh.triangles, as_it_was.triangles);
}

TEST_F(TwoReplicas, TheQualityPassLeavesNoSharpAngleThatTheOutlineDoesNotAskFor) {
  for (const double min_angle_deg : {0.0, 20.0}) {
    Remesher remesher(*place_slices(scene_, test::square_asset(2), "a"), {min_angle_deg});
    Pose pose;
    pose.p_m = {0.0004, 0.0003, 0.1};
    const Sheet& placed = remesher.first_version(0);
    ASSERT_TRUE(remesher.request(
        {0, 1, outline_on_lattice(make_tool(scene_.tool), pose, placed.transform, placed.z_m)}));
    remesher.stop();
    const SliceMesh mesh = to_slice_mesh(remesher.last_version(0).mesh);
    double smallest_deg = 90;
    for (const Triangle& t : mesh.triangles) {
      for (int i = 0; i < 3; ++i) {
        const LatticePoint a = mesh.vertices[t[i]], b = mesh.vertices[t[(i + 1) % 3]],
                           c = mesh.vertices[t[(i + 2) % 3]];
        const double cross = static_cast<double>(orient2d(a, b, c));
        const double dot = static_cast<double>(diametral_dot(b, c, a));
        smallest_deg = std::min(smallest_deg, std::atan2(cross, dot) * 180 / 3.14159265358979);
      }
    }
    EXPECT_EQ(smallest_deg >= 20, min_angle_deg > 0) << smallest_deg;
    EXPECT_EQ(remesher.records()[0].quality_vertices > 0, min_angle_deg > 0);
  }
}

TEST(SpscQueue, KeepsOrderAndCapacityBetweenTwoThreads) {
  SpscQueue<std::uint64_t, 8> small;
  for (std::uint64_t i = 0; i < 8; ++i)
    EXPECT_TRUE(small.push(i));
  EXPECT_FALSE(small.push(8));
  std::uint64_t value = 99;
  EXPECT_TRUE(small.pop(value));
  EXPECT_EQ(value, 0U);
  EXPECT_TRUE(small.push(8));
  for (std::uint64_t i = 1; i <= 8; ++i)
    EXPECT_TRUE(small.pop(value) && value == i);
  EXPECT_FALSE(small.pop(value));

  auto queue = std::make_unique<SpscQueue<std::uint64_t, 64>>();
  constexpr std::uint64_t kCount = 200'000;
  std::thread writer([&] {
    for (std::uint64_t i = 0; i < kCount;) {
      if (queue->push(i)) {
        ++i;
      } else {
        std::this_thread::yield();
      }
    }
  });
  for (std::uint64_t expected = 0; expected < kCount;) {
    if (queue->pop(value)) {
      ASSERT_EQ(value, expected);
      ++expected;
    } else {
      std::this_thread::yield();
    }
  }
  writer.join();
  EXPECT_FALSE(queue->pop(value));
}

TEST(TripleBuffer, GivesWholeValuesNeverAnOlderOne) {
  struct Value {
    std::array<std::uint64_t, 16> copies{};
  };
  TripleBuffer<Value> buffer;
  Value value;
  EXPECT_FALSE(buffer.read(value));
  constexpr std::uint64_t kCount = 200'000;
  std::thread writer([&] {
    Value next;
    for (std::uint64_t i = 1; i <= kCount; ++i) {
      next.copies.fill(i);
      buffer.write(next);
    }
  });
  std::uint64_t last = 0;
  while (last < kCount) {
    if (!buffer.read(value)) {
      std::this_thread::yield();
      continue;
    }
    ASSERT_GT(value.copies[0], last);
    last = value.copies[0];
    for (const std::uint64_t copy : value.copies)
      ASSERT_EQ(copy, last) << "torn";
  }
  writer.join();
  EXPECT_FALSE(buffer.read(value));
}

// A value is a number and what follows from it, so that a mixture of two shows.
struct Numbered {
  std::array<std::uint64_t, 40> words{};
  static Numbered of(std::uint64_t i) {
    Numbered out;
    for (std::size_t w = 0; w < out.words.size(); ++w)
      out.words[w] = i * 0x9E3779B97F4A7C15U + w;
    return out;
  }
  bool operator==(const Numbered&) const = default;
};

TEST(OverwritingRing, GivesTheValuesAskedForOrSaysThatTheyAreGone) {
  OverwritingRing<Numbered> ring(8);
  for (std::uint64_t i = 0; i < 13; ++i)
    ring.push(Numbered::of(i));
  EXPECT_EQ(ring.pushed(), 13U);
  std::vector<Numbered> out{Numbered::of(99)};
  // Value 5 is the next to go: the writer may be at it.
  EXPECT_FALSE(ring.copy(4, 8, out));
  EXPECT_FALSE(ring.copy(5, 13, out));
  EXPECT_EQ(out.size(), 1U);
  ASSERT_TRUE(ring.copy(6, 13, out));
  ASSERT_EQ(out.size(), 8U);
  EXPECT_EQ(out[0], Numbered::of(99));
  for (std::uint64_t i = 6; i < 13; ++i)
    EXPECT_EQ(out[static_cast<std::size_t>(i - 5)], Numbered::of(i));
}

TEST(OverwritingRing, NeverGivesAMixtureWhileItIsOverwritten) {
  constexpr std::uint64_t kPushes = 400'000;
  OverwritingRing<Numbered> ring(16);
  std::atomic<std::uint64_t> seen{0};
  std::jthread writer([&] {
    for (std::uint64_t i = 0; i < kPushes; ++i) {
      ring.push(Numbered::of(i));
      seen.store(i + 1, std::memory_order_release);
    }
  });
  std::uint64_t given = 0, gone = 0;
  std::vector<Numbered> out;
  while (seen.load(std::memory_order_acquire) < kPushes || given == 0) {
    const std::uint64_t end = seen.load(std::memory_order_acquire);
    const std::uint64_t first = end - std::min<std::uint64_t>(end, 12);
    out.clear();
    if (!ring.copy(first, end, out)) {
      ++gone;
      continue;
    }
    ++given;
    ASSERT_EQ(out.size(), end - first);
    for (std::uint64_t i = first; i < end; ++i)
      ASSERT_EQ(out[static_cast<std::size_t>(i - first)], Numbered::of(i)) << i;
  }
  writer.join();
  EXPECT_GT(given, 0U);
  RecordProperty("gone", static_cast<int>(gone));
}

TEST(Histogram, QuantilesAreThoseOfTheSamplesWithinABucket) {
  Histogram empty;
  EXPECT_EQ(empty.quantile_us(0.5), 0);
  std::mt19937_64 random(6);
  std::vector<std::int64_t> samples;
  Histogram histogram;
  for (int i = 0; i < 20'000; ++i) {
    samples.push_back(static_cast<std::int64_t>(random() >> (24 + random() % 40)));
    histogram.add(samples.back());
  }
  std::sort(samples.begin(), samples.end());
  for (const double share : {0.001, 0.1, 0.5, 0.9, 0.99, 0.999, 1.0}) {
    const auto rank = static_cast<std::size_t>(std::ceil(share * 20'000)) - 1;
    const double exact_us = static_cast<double>(samples[rank]) * 1e-3;
    EXPECT_GE(histogram.quantile_us(share), exact_us);
    EXPECT_LE(histogram.quantile_us(share), exact_us * (1 + 1.0 / 64) + 1e-3);
  }
  EXPECT_EQ(histogram.max_us(), static_cast<double>(samples.back()) * 1e-3);
  histogram.add(-5);
  histogram.add(INT64_MAX);
  EXPECT_EQ(histogram.samples(), 20'002U);
}

TEST(RealtimeThread, CallsAtTheRateUntilToldToEnd) {
  std::uint64_t calls = 0;
  double gaps_s = 0;
  RealtimeOptions options;
  options.rate_Hz = 1000;
  const auto start = std::chrono::steady_clock::now();
  const RealtimeReport report = run_realtime(options, [&](const TickTiming& timing) {
    EXPECT_GE(timing.gap_s, 0);
    gaps_s += timing.gap_s;
    return ++calls < 200;
  });
  const double took_s =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  EXPECT_EQ(calls, 200U);
  EXPECT_GE(took_s, 0.199) << "never faster than the rate";
  EXPECT_GE(gaps_s, 0.19);
  EXPECT_EQ(report.wake.samples(), 200U);
  EXPECT_TRUE(report.fifo && report.memory_locked ? report.note.empty() : !report.note.empty());

  std::atomic<bool> stop{true};
  options.stop = &stop;
  run_realtime(options, [](const TickTiming&) {
    ADD_FAILURE();
    return true;
  });
}

TEST(RealtimeThread, ALateCallIsCountedAndNotMadeUpFor) {
  RealtimeOptions options;
  options.rate_Hz = 1000;
  int calls = 0;
  const auto start = std::chrono::steady_clock::now();
  const RealtimeReport report = run_realtime(options, [&](const TickTiming&) {
    if (calls == 0) std::this_thread::sleep_for(std::chrono::milliseconds(20));
    return ++calls < 10;
  });
  const double took_s =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  EXPECT_GE(report.missed_deadlines, 1U);
  EXPECT_GE(took_s, 0.028) << "the nine others still take their millisecond each";
}

}  // namespace
}  // namespace trocar::runtime
