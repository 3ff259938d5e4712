// SPDX-License-Identifier: Apache-2.0
// The queue and buffers between the haptic thread and other threads, each used by two threads; the
// histogram of durations; the realtime thread.
#include <gtest/gtest.h>
#include <pthread.h>
#include <sys/prctl.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdint>
#include <ctime>
#include <memory>
#include <numeric>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "runtime/realtime/histogram.h"
#include "runtime/realtime/queues.h"
#include "runtime/realtime/realtime_thread.h"

namespace trocar::runtime {
namespace {

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

TEST(TripleBuffer, ReaderSeesCompleteValuesInAscendingOrder) {
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

// All words of a value follow from its number, so that a mixture of two values is detected.
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

TEST(RingBuffer, CopyGivesTheRequestedValuesOrFails) {
  RingBuffer<Numbered> ring(8);
  for (std::uint64_t i = 0; i < 13; ++i)
    ring.push(Numbered::of(i));
  EXPECT_EQ(ring.pushed(), 13U);
  std::vector<Numbered> out{Numbered::of(99)};
  // Value 5 is the next to be overwritten: the writer may be writing it now.
  EXPECT_FALSE(ring.copy(4, 8, out));
  EXPECT_FALSE(ring.copy(5, 13, out));
  EXPECT_EQ(out.size(), 1U);
  ASSERT_TRUE(ring.copy(6, 13, out));
  ASSERT_EQ(out.size(), 8U);
  EXPECT_EQ(out[0], Numbered::of(99));
  for (std::uint64_t i = 6; i < 13; ++i)
    EXPECT_EQ(out[static_cast<std::size_t>(i - 5)], Numbered::of(i));
}

TEST(RingBuffer, CopyIsNeverAMixtureWhileTheWriterOverwrites) {
  constexpr std::uint64_t kPushes = 400'000;
  RingBuffer<Numbered> ring(16);
  std::atomic<std::uint64_t> seen{0};
  std::jthread writer([&] {
    for (std::uint64_t i = 0; i < kPushes; ++i) {
      ring.push(Numbered::of(i));
      seen.store(i + 1, std::memory_order_release);
    }
  });
  std::uint64_t given = 0;
  std::vector<Numbered> out;
  while (seen.load(std::memory_order_acquire) < kPushes || given == 0) {
    const std::uint64_t end = seen.load(std::memory_order_acquire);
    const std::uint64_t first = end - std::min<std::uint64_t>(end, 12);
    out.clear();
    if (!ring.copy(first, end, out)) continue;  // overwritten
    ++given;
    ASSERT_EQ(out.size(), end - first);
    for (std::uint64_t i = first; i < end; ++i)
      ASSERT_EQ(out[static_cast<std::size_t>(i - first)], Numbered::of(i)) << i;
  }
  writer.join();
  EXPECT_GT(given, 0U);
}

TEST(Histogram, QuantilesEqualThoseOfTheSamplesUpToABucket) {
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

TEST(RealtimeThread, CallsAtTheRateUntilItReturnsFalseOrStopIsSet) {
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

// A realtime thread has no slack; without realtime rights it is set to the least, 1 ns.
TEST(RealtimeThread, ItsTimerSlackIsTheLeast) {
  int slack_ns = -1;
  const RealtimeReport report = run_realtime({}, [&](const TickTiming&) {
    slack_ns = ::prctl(PR_GET_TIMERSLACK);
    return false;
  });
  EXPECT_GE(slack_ns, 0);
  EXPECT_LE(slack_ns, 1);
  EXPECT_EQ(report.timer_slack_ns, slack_ns);
}

TEST(RealtimeThread, OtherThreadsKeepOffItsProcessor) {
  cpu_set_t before;
  ASSERT_EQ(::pthread_getaffinity_np(::pthread_self(), sizeof before, &before), 0);
  int cpu = CPU_SETSIZE - 1;
  while (!CPU_ISSET(cpu, &before))
    --cpu;
  const bool has_others = CPU_COUNT(&before) > 1;
  std::thread thread([&] {
    keep_off(-1);
    cpu_set_t now;
    ::pthread_getaffinity_np(::pthread_self(), sizeof now, &now);
    EXPECT_TRUE(CPU_EQUAL(&now, &before));
    keep_off(cpu);
    std::thread started([&] { ::pthread_getaffinity_np(::pthread_self(), sizeof now, &now); });
    started.join();
    EXPECT_EQ(CPU_ISSET(cpu, &now), !has_others);
    EXPECT_EQ(CPU_COUNT(&now), CPU_COUNT(&before) - (has_others ? 1 : 0));
    RealtimeOptions options;
    options.cpu = cpu;
    const RealtimeReport report = run_realtime(options, [](const TickTiming&) { return false; });
    EXPECT_EQ(report.cpus, std::to_string(cpu));
  });
  thread.join();
}

// Each period is that of a call or of a missed deadline, and the longest run is one that a call
// saw.
TEST(RealtimeThread, MissedDeadlinesAndTheirLongestRunAgree) {
  RealtimeOptions options;
  options.rate_Hz = 1000;
  int calls = 0, longest = 0;
  double since_first_s = 0;
  const RealtimeReport report = run_realtime(options, [&](const TickTiming& timing) {
    since_first_s += timing.gap_s;
    longest = std::max(longest, timing.missed_in_row);
    if (calls % 10 == 3) std::this_thread::sleep_for(std::chrono::milliseconds(5));
    return ++calls < 40;
  });
  EXPECT_EQ(report.missed_in_row_max, longest);
  EXPECT_GE(longest, 5);
  EXPECT_GE(report.missed_deadlines, 20U);
  EXPECT_NEAR(static_cast<double>(report.missed_deadlines) + calls - 1,
              since_first_s * options.rate_Hz, 1.001);
}

// The machine stops the thread in its sleep; here a signal handler does.
TEST(RealtimeThread, ACallThatWakesUpLateKnowsBeforeItActs) {
  struct sigaction action {};
  action.sa_handler = [](int) {
    const timespec stop{0, 6'000'000};
    ::nanosleep(&stop, nullptr);
  };
  struct sigaction before {};
  ASSERT_EQ(::sigaction(SIGUSR2, &action, &before), 0);
  RealtimeOptions options;
  options.rate_Hz = 1000;
  std::atomic<pthread_t> thread{};
  std::atomic<bool> done{false};
  std::thread machine([&] {
    while (!done.load()) {
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
      if (thread.load() != pthread_t{}) ::pthread_kill(thread.load(), SIGUSR2);
    }
  });
  int calls = 0, late = 0;
  run_realtime(
      options,
      [&](const TickTiming& timing) {
        thread.store(::pthread_self());
        const int periods = static_cast<int>(timing.gap_s * options.rate_Hz);
        // The last call may have started up to a period after its time.
        EXPECT_GE(timing.missed_in_row, periods - 1) << "call " << calls;
        if (periods > 5) ++late;
        return ++calls < 150;
      },
      [&] {  // the thread is still there
        thread.store(pthread_t{});
        done.store(true);
        machine.join();
      });
  ::sigaction(SIGUSR2, &before, nullptr);
  EXPECT_GE(late, 3);
}

// Missed deadlines are attributed to the part of the period that took the time, none twice and none to nothing.

constexpr double kPeriod_ns = 1e6;

TickTiming timing(std::uint64_t missed, double late_periods) {
  TickTiming timing;
  timing.missed_deadlines = missed;
  timing.late_ns = static_cast<std::int64_t>(late_periods * kPeriod_ns);
  return timing;
}

TEST(LateTicks, AreThoseOfTheLongestPartOfTheTickBefore) {
  for (const TickPart part : {TickPart::kDevice, TickPart::kLaw, TickPart::kPublishing}) {
    LateTicks late;
    late.begin(timing(0, 0.02), kPeriod_ns);
    for (const TickPart each : {TickPart::kDevice, TickPart::kLaw, TickPart::kPublishing})
      late.spend(each, each == part ? 3'200'000 : 40'000);
    late.begin(timing(3, 0.02), kPeriod_ns);
    LateTicks::Counts wanted{};
    wanted[static_cast<std::size_t>(part)] = 3;
    EXPECT_EQ(late.counts(), wanted);
    // The time of an earlier tick does not count again.
    late.spend(TickPart::kDevice, 50'000);
    late.begin(timing(3, 0.9), kPeriod_ns);
    EXPECT_EQ(late.counts(), wanted);
  }
}

TEST(LateTicks, AreThoseOfWakingIfTheyPassedWhileTheThreadSlept) {
  LateTicks late;
  late.begin(timing(0, 0.02), kPeriod_ns);
  late.spend(TickPart::kLaw, 2'100'000);     // two deadlines are missed,
  late.begin(timing(32, 30.4), kPeriod_ns);  // and then the machine stalls for 30 periods
  EXPECT_EQ(late.counts(), (LateTicks::Counts{30, 0, 2, 0}));
  EXPECT_EQ(std::accumulate(late.counts().begin(), late.counts().end(), std::uint64_t{0}), 32U);
}

TEST(LateTicks, BeforeTheFirstTickAreThoseOfWaking) {
  LateTicks late;
  late.begin(timing(5, 5.5), kPeriod_ns);
  EXPECT_EQ(late.counts(), (LateTicks::Counts{5, 0, 0, 0}));
}

}  // namespace
}  // namespace trocar::runtime
