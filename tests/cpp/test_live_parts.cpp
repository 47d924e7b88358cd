// Claims about the parts of the live loop that threads and processes share: nothing is torn, nothing is lost unseen,
// and percentiles are right to a class's width.

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "claim.hpp"
#include "runtime/durations.hpp"
#include "runtime/queue.hpp"
#include "runtime/ring.hpp"

using namespace tenodesis::runtime;

constexpr std::size_t columns = 40;

std::string place(const char* name) { return "/tmp/tenodesis-" + std::to_string(::getpid()) + "-" + name; }

void percentiles_are_right_to_a_sixteenth() {
  std::mt19937 random(1);  // NOLINT(cert-msc32-c,cert-msc51-cpp,bugprone-random-generator-seed): the same on every run
  std::lognormal_distribution<double> pick(8, 2);
  Durations durations;
  std::vector<std::uint64_t> all;
  for (int i = 0; i < 20'000; ++i) {
    all.push_back(static_cast<std::uint64_t>(pick(random)));
    durations.note(all.back());
  }
  std::ranges::sort(all);
  for (const double share : {0.0, 0.1, 0.5, 0.9, 0.99, 0.9999}) {
    const auto exact = double(all[std::size_t(share * double(all.size()))]);
    const auto estimate = double(durations.percentile(share));
    CLAIM(estimate >= exact);
    CLAIM(estimate <= exact * (1 + 1.0 / 16) + 1);
  }
  CLAIM(durations.worst() == all.back());
  CLAIM(durations.count() == all.size());
  durations.clear();
  CLAIM(durations.percentile(0.5) == 0);
  durations.note(UINT64_MAX);
  CLAIM(durations.percentile(0.5) == UINT64_MAX);
}

void a_queue_keeps_the_order_and_refuses_what_does_not_fit() {
  Queue<int, 8> queue;
  for (int i = 0; i < 8; ++i) CLAIM(queue.push(i));
  CLAIM(!queue.push(8));
  int got = -1;
  CLAIM(queue.pop(got) && got == 0);
  CLAIM(queue.push(8));
  CLAIM(queue.pending() == 8);

  Queue<std::uint64_t, 64> between;
  constexpr std::uint64_t count = 200'000;
  std::thread giver([&] {
    for (std::uint64_t i = 0; i < count;) {
      if (between.push(i))
        ++i;
      else
        std::this_thread::yield();
    }
  });
  bool in_order = true;
  for (std::uint64_t i = 0; i < count;) {
    std::uint64_t item = 0;
    if (!between.pop(item)) {
      std::this_thread::yield();
      continue;
    }
    in_order = in_order && item == i++;
  }
  giver.join();
  CLAIM(in_order);
}

// All values of a record are equal, so that a torn record is noticed.
void a_reader_never_sees_a_torn_record_and_knows_what_it_missed() {
  const std::string path = place("ring");
  constexpr std::uint64_t count = 100'000;
  {
    RingWriter writer(path, columns, 60);
    const RingReader reader(path);
    CLAIM(reader.capacity() == 64);
    CLAIM(reader.columns() == columns);
    std::thread writing([&] {
      std::vector<double> record(columns);
      for (std::uint64_t i = 0; i < count; ++i) {
        std::ranges::fill(record, double(i));
        writer.write(record);
        if (i % 64 == 0) std::this_thread::yield();
      }
    });
    std::vector<double> rows(columns * 16);
    std::uint64_t cursor = 0, lost = 0, seen = 0;
    bool undivided = true, in_order = true;
    double last = -1;
    while (cursor < count) {
      const std::size_t got = reader.read(cursor, 16, rows.data(), lost);
      for (std::size_t i = 0; i < got; ++i) {
        const double* row = rows.data() + i * columns;
        undivided = undivided && std::all_of(row, row + columns, [&](double item) { return item == row[0]; });
        in_order = in_order && row[0] > last;
        last = row[0];
      }
      seen += got;
    }
    writing.join();
    CLAIM(undivided);
    CLAIM(in_order);
    CLAIM(seen + lost == count);
    CLAIM(seen > 0);
  }
  CLAIM(std::remove(path.c_str()) == 0);
}

void a_file_that_is_no_ring_is_refused() {
  const std::string path = place("no-ring");
  std::FILE* file = std::fopen(path.c_str(), "wb");
  const std::vector<char> bytes(8192, 7);
  CLAIM(std::fwrite(bytes.data(), 1, bytes.size(), file) == bytes.size());
  CLAIM(std::fclose(file) == 0);
  bool refused = false;
  try {
    const RingReader reader(path);
  } catch (const std::invalid_argument&) {
    refused = true;
  }
  CLAIM(refused);
  CLAIM(std::remove(path.c_str()) == 0);
}

int main() {  // NOLINT(bugprone-exception-escape): what is thrown here ends the test, as it should
  percentiles_are_right_to_a_sixteenth();
  a_queue_keeps_the_order_and_refuses_what_does_not_fit();
  a_reader_never_sees_a_torn_record_and_knows_what_it_missed();
  a_file_that_is_no_ring_is_refused();
  return claims::report();
}
