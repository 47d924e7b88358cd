#pragma once
// Real-time scheduling and locked memory, requested from the operating system.

#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>

#include <cerrno>
#include <cstring>
#include <string>
#include <vector>

namespace tenodesis::runtime {

/// Requests real-time scheduling of this thread and locked memory; returns a sentence per refusal.
inline std::vector<std::string> ask_for_real_time(int priority) {
  std::vector<std::string> refused;
  sched_param wanted{};
  wanted.sched_priority = priority;
  if (const int problem = ::pthread_setschedparam(::pthread_self(), SCHED_FIFO, &wanted); problem != 0)
    refused.push_back("No real-time scheduling (" + std::string(std::strerror(problem)) +
                      "): other programs may delay a tick. Give the user an rtprio limit, or run on a bench PC.");
  if (::mlockall(MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT) != 0)
    refused.push_back("Memory is not locked (" + std::string(std::strerror(errno)) +
                      "): a page from the disk may delay a tick. Raise the memlock limit.");
  return refused;
}

/// Returns this thread to ordinary scheduling: in real time it would starve others if it never slept.
inline void yield_real_time() {
  const sched_param ordinary{};
  ::pthread_setschedparam(::pthread_self(), SCHED_OTHER, &ordinary);
}

}  // namespace tenodesis::runtime
