// SPDX-License-Identifier: Apache-2.0
// Replaces the C library's waiting functions: each call is counted, then passed to the original,
// which dlsym finds as the next definition. A definition in the program takes precedence over
// libc's for every library of the process.
#include <dlfcn.h>
#include <pthread.h>
#include <semaphore.h>

#include "tests/reference/hooks/lock_counter.h"

namespace {

// dlsym itself calls none of the functions below.
template <typename Function>
Function next(const char* name) {
  return reinterpret_cast<Function>(::dlsym(RTLD_NEXT, name));
}

}  // namespace

extern "C" {

int pthread_mutex_lock(pthread_mutex_t* mutex) noexcept {
  static const auto original = next<int (*)(pthread_mutex_t*)>("pthread_mutex_lock");
  trocar::runtime::note_lock();
  return original(mutex);
}
int pthread_rwlock_rdlock(pthread_rwlock_t* lock) noexcept {
  static const auto original = next<int (*)(pthread_rwlock_t*)>("pthread_rwlock_rdlock");
  trocar::runtime::note_lock();
  return original(lock);
}
int pthread_rwlock_wrlock(pthread_rwlock_t* lock) noexcept {
  static const auto original = next<int (*)(pthread_rwlock_t*)>("pthread_rwlock_wrlock");
  trocar::runtime::note_lock();
  return original(lock);
}
int pthread_cond_wait(pthread_cond_t* condition, pthread_mutex_t* mutex) {
  static const auto original =
      next<int (*)(pthread_cond_t*, pthread_mutex_t*)>("pthread_cond_wait");
  trocar::runtime::note_lock();
  return original(condition, mutex);
}
int sem_wait(sem_t* semaphore) {
  static const auto original = next<int (*)(sem_t*)>("sem_wait");
  trocar::runtime::note_lock();
  return original(semaphore);
}

}  // extern "C"
