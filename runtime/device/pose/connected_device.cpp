// SPDX-License-Identifier: Apache-2.0
#include "runtime/device/pose/connected_device.h"

#include <condition_variable>
#include <mutex>

#include "runtime/realtime/realtime_thread.h"

namespace trocar::runtime {

/// The mutex guards all members.
struct CallThread::Shared {
  std::mutex mutex;
  std::condition_variable changed;
  std::function<void()> next;
  std::function<void()> at_last;  ///< follows the call that is running
  bool running = false;
  bool ending = false;
  bool ended = false;

  bool idle() const { return !running && !next && !at_last; }
  template <typename Condition>
  bool wait(std::unique_lock<std::mutex>& lock, double seconds, Condition condition) {
    return changed.wait_for(lock, std::chrono::duration<double>(seconds), condition);
  }
};

CallThread::CallThread()
    : shared_(std::make_shared<Shared>()), thread_([shared = shared_] { serve(shared); }) {}

CallThread::~CallThread() {
  std::unique_lock lock(shared_->mutex);
  shared_->ending = true;
  shared_->changed.notify_all();
  const bool ended = shared_->wait(lock, kPatience_s, [this] { return shared_->ended; });
  lock.unlock();
  if (ended)
    thread_.join();
  else
    thread_.detach();
}

bool CallThread::run(std::function<void()> function, double timeout_s) {
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::duration<double>(timeout_s);
  const auto idle = [this] { return shared_->idle(); };
  std::unique_lock lock(shared_->mutex);
  if (!shared_->changed.wait_until(lock, deadline, idle)) return false;
  shared_->next = std::move(function);
  shared_->changed.notify_all();
  if (shared_->changed.wait_until(lock, deadline, idle)) return true;
  shared_->next = nullptr;  // in case that the thread has not taken it yet
  return false;
}

void CallThread::call_at_last(std::function<void()> function) {
  std::unique_lock lock(shared_->mutex);
  shared_->at_last = std::move(function);
  shared_->changed.notify_all();
  shared_->wait(lock, kPatience_s, [this] { return shared_->idle(); });
}

void CallThread::serve(const std::shared_ptr<Shared>& shared) {
  request_priority(kPriority);
  std::unique_lock lock(shared->mutex);
  for (;;) {
    shared->changed.wait(lock, [&] { return shared->next || shared->at_last || shared->ending; });
    auto& chosen = shared->next ? shared->next : shared->at_last;
    if (!chosen) break;
    shared->running = true;
    const std::function<void()> function = std::exchange(chosen, nullptr);
    lock.unlock();
    function();
    lock.lock();
    shared->running = false;
    shared->changed.notify_all();
  }
  shared->ended = true;
  shared->changed.notify_all();
}

namespace {

/// Pause between two attempts to connect again, and between two looks for a request to do so.
constexpr std::int64_t kRetryPause_ns = 100'000'000, kPollPause_ns = 2'000'000;

void pause(std::int64_t duration_ns) {
  if (duration_ns > 0) std::this_thread::sleep_for(std::chrono::nanoseconds(duration_ns));
}

}  // namespace

ConnectedDevice::ConnectedDevice(std::unique_ptr<PoseConnection> connection, double period_s,
                                 SayLine say)
    : connection_(std::move(connection)),
      period_ns_(std::llround(period_s * 1e9)),
      stale_s_(std::max(kStaleCommand_s, kStalePeriods * period_s)),
      say_(std::move(say)) {}

ConnectedDevice::~ConnectedDevice() {
  ConnectedDevice::close();
}

Result<void> ConnectedDevice::start() {
  if (thread_.joinable()) return bug("a device is started once");
  if (Result<void> opened = connection_->open(); !opened) {
    connection_->close();
    return opened.error();
  }
  state_.store(State::kConnected);
  sessions_ = 1;
  thread_ = std::thread([this] { run(); });
  return {};
}

DeviceStatus ConnectedDevice::read(PoseReading& reading) noexcept {
  const bool is_connected = state_.load(std::memory_order_acquire) == State::kConnected;
  Answer answer;
  // An answer that is still there after a loss is dropped: it would be old after the reconnection.
  const bool is_answered = answers_.read(answer);
  if (!is_connected) return DeviceStatus::kLinkLost;
  if (!is_answered || answer.reading.t_s == last_t_s_) return DeviceStatus::kNoData;
  last_t_s_ = answer.reading.t_s;
  reading = answer.reading;
  if (answer.command_ns > last_answered_ns_) {
    last_answered_ns_ = answer.command_ns;
    round_trip_.add(monotonic_ns() - answer.command_ns);
  }
  return DeviceStatus::kOk;
}

DeviceStatus ConnectedDevice::write(const HandleWrench& wrench) noexcept {
  commands_.write({wrench, monotonic_ns()});
  return DeviceStatus::kOk;
}

void ConnectedDevice::restore() noexcept {
  State lost = State::kLost;
  state_.compare_exchange_strong(lost, State::kRestoring);
}

void ConnectedDevice::close() {
  closing_.store(true);
  if (thread_.joinable()) {
    thread_.join();
    connection_->close();
  }
  state_.store(State::kLost);
}

std::optional<LinkReport> ConnectedDevice::link_report() const {
  return LinkReport{sessions_, std::nullopt, round_trip_, std::nullopt};
}

void ConnectedDevice::lose(const Error& error) {
  state_.store(State::kLost, std::memory_order_release);
  connection_->close();
  command_ = {};
  if (std::exchange(said_, error.message) != error.message) say_(error.message);
}

void ConnectedDevice::exchange_once() {
  commands_.read(command_);
  const double age_s = static_cast<double>(monotonic_ns() - command_.at_ns) * 1e-9;
  const bool is_fresh = age_s < stale_s_;
  const Result<PoseReading> reading =
      connection_->exchange(is_fresh ? command_.wrench : HandleWrench{});
  refused_.set(connection_->refused_contents());
  if (!reading) return lose(reading.error());
  answers_.write({*reading, is_fresh ? command_.at_ns : 0});
  said_.clear();
}

void ConnectedDevice::run() {
  request_priority(kConnectionPriority);
  while (!closing_.load()) {
    switch (state_.load(std::memory_order_acquire)) {
      case State::kConnected: {
        const std::int64_t begin_ns = monotonic_ns();
        exchange_once();
        pause(begin_ns + period_ns_ - monotonic_ns());
        break;
      }
      case State::kRestoring:
        if (const Result<void> opened = connection_->open()) {
          ++sessions_;
          commands_.read(command_);
          command_ = {};  // a force from before the loss is not rendered after it
          state_.store(State::kConnected, std::memory_order_release);
        } else {
          refused_.set({});
          lose(opened.error());
          pause(kRetryPause_ns);
        }
        break;
      case State::kLost:
        pause(kPollPause_ns);
        break;
    }
  }
}

}  // namespace trocar::runtime
