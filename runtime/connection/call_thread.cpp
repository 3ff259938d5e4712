// SPDX-License-Identifier: Apache-2.0
#include "runtime/connection/call_thread.h"

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <utility>

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
  if (ended) {
    thread_.join();
  } else {
    thread_.detach();
  }
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

}  // namespace trocar::runtime
