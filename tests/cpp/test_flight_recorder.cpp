// Claims about the flight recorder: it keeps what led to a fault.

#include "tenodesis/flight_recorder.hpp"

#include <initializer_list>

#include "claim.hpp"

using namespace tenodesis;

void the_recorder_keeps_what_led_to_a_fault_in_order() {
  FlightRecorder<int, 12, 3, 4> recorder{};
  CLAIM(recorder.size() == 0 && recorder.fault_place() == -1);
  for (const int fault_at : {0, 1, 5, 100, 101, 102}) {
    recorder.rearm();
    for (int n = 0; n < fault_at; ++n) recorder.note(n, false);
    CLAIM(!recorder.frozen());
    int ticks = 0;
    // The fault holds, goes and comes again: only its first tick counts.
    for (int n = fault_at; !recorder.frozen() && ticks < 100; ++n, ++ticks) recorder.note(n, ticks % 4 == 0);
    CLAIM(ticks == 4 * 3 + 1);
    const int size = recorder.size();
    const int place = recorder.fault_place();
    CLAIM(size == std::min(12, (fault_at + 2) / 3 + 5));
    CLAIM(place == size - 5);
    CLAIM(recorder[place] == fault_at);
    for (int n = place; n + 1 < size; ++n) CLAIM(recorder[n + 1] - recorder[n] == 3);
    for (int n = 0; n < place; ++n) CLAIM(recorder[n] == (place - n > 0 ? ((fault_at + 2) / 3 - (place - n)) * 3 : 0));
    const int last = recorder[size - 1];
    recorder.note(-7, true);
    CLAIM(recorder.size() == size && recorder[size - 1] == last);
  }
  recorder.rearm();
  CLAIM(recorder.size() == 0 && !recorder.frozen() && recorder.fault_place() == -1);
}

void a_recorder_that_keeps_nothing_after_freezes_on_the_fault() {
  FlightRecorder<int, 4> recorder{};
  for (int n = 0; n < 10; ++n) recorder.note(n, n == 6);
  CLAIM(recorder.frozen() && recorder.size() == 4 && recorder.fault_place() == 3);
  for (int n = 0; n < 4; ++n) CLAIM(recorder[n] == 3 + n);
}

int main() {
  the_recorder_keeps_what_led_to_a_fault_in_order();
  a_recorder_that_keeps_nothing_after_freezes_on_the_fault();
  return claims::report();
}
