#pragma once
// The live loop: a thread of its own that reads the device, steps the controller, commands the motors, and writes every
// tick into a ring. It never waits for those who watch or command it.

#include <pthread.h>
#include <signal.h>
#include <time.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "durations.hpp"
#include "followers.hpp"
#include "orders.hpp"
#include "queue.hpp"
#include "realtime.hpp"
#include "ring.hpp"

namespace tenodesis::runtime {

using engine::AnyController, engine::AnyInput;

class Runtime {
 public:
  static constexpr std::size_t played_ahead = 4096;

  /// Device and controller must outlive it, and belong to it between start and finish.
  Runtime(Device& device, AnyController& controller, const Settings& settings, const std::string& ring,
          std::size_t ring_capacity)
      : device_(device),
        controller_(controller),
        settings_(settings),
        ring_(ring, columns(device, settings.axes.size()), ring_capacity),
        record_(columns(device, settings.axes.size())),
        command_(device.commands.width()),
        before_(command_),
        spools_(device.commands.find("spool_velocity").first),
        contacts_(device.commands.find("contact")),
        hand_(device.commands.find("handle_angle").second),
        motors_(settings_, device.sizes.tendons) {}

  ~Runtime() { finish(); }
  Runtime(const Runtime&) = delete;
  Runtime& operator=(const Runtime&) = delete;

  void start() {
    if (thread_.joinable()) return;
    ending_.store(false);
    thread_ = std::thread([this] { run(0); });
  }

  /// Takes so many ticks as fast as possible, on the caller's thread.
  void run_ticks(std::uint64_t count) {
    settings_.speed = 0;
    settings_.real_time = false;
    run(count);
  }

  void finish() {
    ending_.store(true);
    if (thread_.joinable()) thread_.join();
  }

  bool running() const { return running_.load(); }

  // For the commanding thread, of which there may be one at a time.

  /// False where too many orders wait already.
  bool order(const Order& order) { return orders_.push(order); }
  bool play(const PlayedTick& tick) { return played_.push(tick); }
  const Columns& commands() const { return device_.commands; }
  std::size_t pending_ticks() const { return played_.pending(); }
  /// The operator is present for so many ns more; 0: is absent. After the first lease, motors are released only while
  /// the operator is present.
  void lease(std::uint64_t nanoseconds) {
    if (nanoseconds == 0) {
      lease_.store(0);
      absent_.store(true);
      return;
    }
    operated_.store(true);
    lease_.store(now() + nanoseconds);
  }
  /// Motors to zero with the next tick, until a request releases them; by any thread, and never refused.
  void stop() { stop_ordered_.store(true); }

  // For watching threads.

  const Durations& compute() const { return compute_; }
  const Durations& control() const { return control_; }
  const Durations& lateness() const { return lateness_; }
  std::uint64_t ticks() const { return ticks_.load(); }
  std::uint64_t late() const { return late_.load(); }
  std::uint64_t missed() const { return missed_.load(); }
  Problem problem() const { return problem_.load(); }
  /// How far the motors hold the tip from where it would be with their spools at home, rad, by axis.
  double wound(std::size_t axis) const { return axis < wound_.size() ? wound_[axis].load() : 0; }
  double speed() const { return speed_.load(); }
  void forget_timing() { forget_.store(true); }
  /// A sentence for each thing that the operating system has refused.
  std::vector<std::string> refused() const {
    const std::scoped_lock lock(refused_mutex_);
    return refused_;
  }

 private:
  struct TimedInjection {
    engine::Injection fault{};
    std::uint64_t until{};  ///< tick
  };
  static constexpr int priority = 50;
  static constexpr std::uint64_t longest_start = 1'000'000'000;  // until a device's first measurement, ns

  // ------------------------------------------------------------------ time

  void run(std::uint64_t most) {
    running_.store(true);
    sigset_t all;
    ::sigfillset(&all);
    if (most == 0) ::pthread_sigmask(SIG_BLOCK, &all, nullptr);
    speed_.store(settings_.speed);
    schedule();
    next_ = begun_ = now();
    for (std::uint64_t taken = 0; !ending_.load(std::memory_order_relaxed) && (most == 0 || taken < most); ++taken)
      take_turn();
    halt();
    running_.store(false);
  }

  // A loop that never sleeps leaves the processor to others.
  void schedule() {
    if (!settings_.real_time) return;
    if (!device_.clocked() && !(settings_.speed > 0)) return yield_real_time();
    const std::vector<std::string> refused = ask_for_real_time(priority);
    const std::scoped_lock lock(refused_mutex_);
    refused_ = refused;
  }

  void take_turn() {
    if (forget_.exchange(false)) forget();
    const std::uint64_t due = device_.clocked() ? 0 : wait();
    input_.request = Request::none;
    bool fresh = true;
    if (device_.clocked()) fresh = device_.read(input_.time, std::uint64_t(2e9 * settings_.period));
    const std::uint64_t begun = now();
    if (!device_.clocked()) fresh = device_.read(input_.time, 0);
    ring_.report_alive(begun);
    // Before a device's first measurement there is nothing to control.
    if (device_.clocked() && !fresh && last_fresh_ == 0) {
      if (begun - begun_ > longest_start) report(Problem::no_measurement);
      return;
    }
    check_time(fresh, due, begun);
    tick(begun, fresh);
    compute_.note(now() - begun);
    ticks_.fetch_add(1, std::memory_order_relaxed);
  }

  std::uint64_t wall_period() const { return std::uint64_t(settings_.period * 1e9 / settings_.speed); }

  /// Sleeps until the tick is due and returns that time; 0 without a clock.
  std::uint64_t wait() {
    if (!(settings_.speed > 0)) return 0;
    next_ += wall_period();
    const timespec until{time_t(next_ / 1'000'000'000), long(next_ % 1'000'000'000)};
    while (::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr) == EINTR) {
    }
    return next_;
  }

  void check_time(bool fresh, std::uint64_t due, std::uint64_t begun) {
    late_now_ = 0;
    if (device_.clocked()) return check_device_time(fresh, begun);
    if (due == 0) return;
    note_lateness(begun > due ? begun - due : 0, wall_period());
    if (!too_long(late_now_)) return;
    // Ticks missed by so much are not made up for: the schedule continues from here.
    missed_.fetch_add((begun - due) / wall_period(), std::memory_order_relaxed);
    next_ = begun;
    if (!device_.simulated()) stop_for(Problem::late);
  }

  void check_device_time(bool fresh, std::uint64_t begun) {
    const std::uint64_t silent = last_fresh_ == 0 ? 0 : begun - last_fresh_;
    if (!fresh) {
      missed_.fetch_add(1, std::memory_order_relaxed);
      if (too_long(silent)) stop_for(Problem::no_measurement);
      return;
    }
    if (last_fresh_ != 0) {
      const auto period = std::uint64_t(settings_.period * 1e9);
      note_lateness(silent > period ? silent - period : 0, period);
      missed_.fetch_add(device_.overtaken(), std::memory_order_relaxed);
      if (too_long(late_now_)) stop_for(Problem::late);
    }
    last_fresh_ = begun;
  }

  bool too_long(std::uint64_t delay) const { return double(delay) > settings_.late_bound * 1e9; }

  void note_lateness(std::uint64_t by, std::uint64_t period) {
    late_now_ = by;
    lateness_.note(by);
    if (by > period / 2) late_.fetch_add(1, std::memory_order_relaxed);
  }

  void forget() {
    compute_.clear();
    control_.clear();
    lateness_.clear();
    late_.store(0);
    missed_.store(0);
    ticks_.store(0);
  }

  // ------------------------------------------------------------------ one tick

  void tick(std::uint64_t begun, bool fresh) {
    // A stop is applied after the orders that came with it.
    const bool absent = absent_.exchange(false), stops = stop_ordered_.exchange(false);
    take_orders();
    std::uint64_t until = lease_.load();
    const bool over = until != 0 && begun > until && lease_.compare_exchange_strong(until, 0);
    if (absent || over) {
      if (controller_.last.state != OperatingState::disabled) report(Problem::operator_gone);
      request(Request::pause);
    }
    if (stops) {
      // A second stop holds what returns.
      returns_ = !stopped_ && controller_.parameters().stop == TENODESIS_STOP_RETURN;
      stopped_ = true;
      if (!returns_) controller_.hold();
      drop_played();
      request(Request::pause);
    }
    take_motion();
    measured_at_ = input_.time;
    for (std::size_t n = 0; n < axes(); ++n)
      input_.axis[n] = controller_.injector.pass(n, device_.reading(settings_.axes[n]),
                                                 [&](std::size_t point) { return injected(n, point); });
    const bool given = inject_into_tick() && !awaits_measurement(begun, fresh);
    // The request of a tick that does not reach the controller is made with the next.
    input_.request = given ? requests_.pop() : Request::none;
    const std::uint64_t asked = now();
    if (given) controller_.step(input_, controller_.last);
    for (std::size_t n = 0; n < axes(); ++n) wound_[n].store(controller_.wound(int(n)), std::memory_order_relaxed);
    const std::uint64_t answered = now();
    control_.note(answered - asked);
    command_motors();
    if (controller_.last.cut_power) device_.cut_power();
    if (!device_.write(command_.data())) {
      report(Problem::tip_lost);
      restore_loads();
    }
    bool in_tissue = false;
    for (std::size_t j = 0; j < contacts_.second / contact_columns; ++j) {
      if (!device_.in_tissue(j)) continue;
      std::fill_n(contact(j), contact_columns, 0.0);
      in_tissue = true;
    }
    if (in_tissue)
      report(Problem::in_tissue);
    else
      withdraw(Problem::in_tissue);
    before_ = command_;
    record(fresh, answered - asked);
    ++tick_;
  }

  std::size_t axes() const { return settings_.axes.size(); }
  double* contact(std::size_t joint) { return command_.data() + contacts_.first + contact_columns * joint; }
  double& velocity(std::size_t tendon) { return command_[spools_ + tendon]; }
  /// Whether a column is a load's: neither the handle's nor a spool's, nor tissue.
  bool is_load(std::size_t column) const {
    const bool spool = column >= spools_ && column < spools_ + device_.sizes.tendons;
    const bool tissue = column >= contacts_.first && column < contacts_.first + contacts_.second;
    return column >= hand_.size() && column < command_.size() && !spool && !tissue;
  }

  void restore_loads() {
    for (std::size_t k = 0; k < command_.size(); ++k)
      if (is_load(k)) command_[k] = before_[k];
  }

  engine::Injection injected(std::size_t axis, std::size_t point) const {
    const TimedInjection& injection = injection_[axis][point];
    return tick_ < injection.until ? injection.fault : engine::Injection{};
  }

  /// False where the tick is left out.
  bool inject_into_tick() {
    const engine::Injection fault = injected(0, engine::at_tick);
    auto time = double(input_.time);
    const bool given = controller_.injector.pass_tick(fault, time);
    if (fault.mode != engine::InjectionMode::none) input_.time = static_cast<std::uint64_t>(time);
    return given;
  }

  /// Whether a measurement is late by less than the controller's watchdog, so that the controller waits for it. The old
  /// one again would mean that time stands still, which is a fault at once.
  bool awaits_measurement(std::uint64_t begun, bool fresh) const {
    if (fresh || !device_.may_be_late()) return false;
    const std::uint64_t silent = begun - last_fresh_;
    return !too_long(silent) && !controller_.watchdog(double(silent) * 1e-9);
  }

  // Motors that were stopped stand first, and then return home as the controller has them.
  bool returning() {
    if (!returns_ || controller_.last.state == OperatingState::enabled) return false;
    for (std::size_t n = 0; n < axes() && !halted_; ++n)
      for (const double sent : controller_.last.axis[n].spool_velocity)
        if (sent != 0) return false;
    halted_ = true;
    return true;
  }

  // Motors without a controller move with those that have one: while it is enabled, and the zero of its spools known.
  void command_motors() {
    const engine::AnyOutput& said = controller_.last;
    const double silent = controller_.injector.silent();
    const bool released = (!stopped_ || returning()) && (silent <= 0 || !controller_.watchdog(silent));
    const bool free = released && said.state == OperatingState::enabled && !said.homing;
    const auto [held, count] = device_.commands.find("spool_tension");
    double* const tensions = count != 0 ? command_.data() + held : nullptr;
    const Problem problem = motors_.command(device_, free, played_now_, command_.data() + spools_, tensions);
    if (problem != Problem::none) stop_for(problem);
    for (std::size_t n = 0; n < axes(); ++n) {
      std::array<double, 2> sent{};
      if (released)
        sent = controller_.injector.pass_pair(n, engine::at_velocity, said.axis[n].spool_velocity,
                                              [&](std::size_t point) { return injected(n, point); });
      velocity(settings_.axes[n].agonist) = sent[0];
      velocity(settings_.axes[n].antagonist) = sent[1];
      // A controller's motors follow its velocities.
      if (tensions != nullptr) tensions[settings_.axes[n].agonist] = tensions[settings_.axes[n].antagonist] = 0;
    }
  }

  void take_orders() {
    Order order;
    while (orders_.pop(order)) {
      switch (order.kind) {
        case OrderKind::request:
          obey(Request(order.a));
          break;
        case OrderKind::law:
          controller_.choose(ControlLaw(order.a), Actuation(order.b));
          break;
        case OrderKind::hand:
          if (order.at < hand_.size()) hand_[order.at].target = within_range(order.at, order.value);
          break;
        case OrderKind::load:
          if (is_load(order.at)) command_[order.at] = order.value;
          withdraw(Problem::tip_lost);
          break;
        case OrderKind::motor:
          motors_.order(order.at, order.value);
          break;
        case OrderKind::speed:
          settings_.speed = order.value;
          speed_.store(order.value);
          schedule();
          next_ = now();
          break;
        case OrderKind::inject_fault:
          if (order.at < axes())
            injection_[order.at][static_cast<std::size_t>(order.a)] = {{engine::InjectionMode(order.b), order.value},
                                                                       tick_ + order.ticks};
          break;
        case OrderKind::drop:
          drop_played();
          for (const auto& [first, count] : {contacts_, device_.commands.find("held")})
            std::fill_n(command_.data() + first, count, 0.0);
          break;
      }
    }
  }

  // A request that releases the motors also clears the reason why they were stopped.
  void obey(Request wanted) {
    if (wanted == Request::enable || wanted == Request::resume || wanted == Request::home || wanted == Request::clear) {
      if (operated_.load() && lease_.load() == 0) return;
      stopped_ = returns_ = halted_ = false;
      problem_.store(Problem::none);
    }
    request(wanted);
  }

  // The hand stays where it is, from where the next motion starts.
  void drop_played() {
    PlayedTick played;
    while (played_.pop(played)) {
    }
    for (std::size_t h = 0; h < hand_.size(); ++h) hand_[h] = {command_[h], command_[h], 0};
  }

  void request(Request wanted) {
    // A request that stops does not wait for those that move.
    const bool disables = requests_.first() == Request::disable;
    if (wanted == Request::disable || (wanted == Request::pause && !disables)) requests_.clear();
    if (requests_.last() != wanted) requests_.push(wanted);
  }

  void stop_for(Problem why) {
    returns_ = false;
    controller_.hold();
    if (!stopped_) {
      stopped_ = true;
      request(Request::pause);
    }
    report(why);
  }

  void withdraw(Problem past) { problem_.compare_exchange_strong(past, Problem::none); }

  // The first problem is kept until the motors are released.
  void report(Problem why) {
    Problem none = Problem::none;
    problem_.compare_exchange_strong(none, why);
  }

  double within_range(std::size_t handle, double angle) const {
    return std::clamp(angle, -settings_.handle_range[handle], settings_.handle_range[handle]);
  }

  void take_motion() {
    PlayedTick played;
    played_now_ = played_.pop(played);
    if (played_now_) {
      std::copy_n(played.begin(), command_.size(), command_.begin());
      for (std::size_t h = 0; h < hand_.size(); ++h) hand_[h] = {command_[h], command_[h], 0};
      return;
    }
    // No faster than a hand.
    for (std::size_t h = 0; h < hand_.size(); ++h) {
      Follower& hand = hand_[h];
      const double wanted = hand.wanted_speed(settings_.period, 1 / settings_.hand_smoothing);
      hand.speed = std::clamp(wanted, -settings_.hand_speed, settings_.hand_speed);
      hand.at = command_[h] = within_range(h, hand.at + settings_.period * hand.speed);
    }
  }

  // ------------------------------------------------------------------ the record

  void record(bool fresh, std::uint64_t controller_time) {
    const engine::AnyOutput& output = controller_.last;
    double* to = record_.data();
    for (const double value : {double(measured_at_) * 1e-9, double(input_.request), double(output.state),
                               double(output.homed), double(output.homing), double(output.first_faults),
                               double(stopped_), double(problem_.load(std::memory_order_relaxed)),
                               double(late_now_) * 1e-9, double(controller_time) * 1e-9, double(fresh)})
      *to++ = value;
    to = std::ranges::copy(command_, to).out;
    device_.store(to);
    to += device_.signals.width();
    for (std::size_t n = 0; n < axes(); ++n) to = std::ranges::copy(engine::control_signals(controller_, n), to).out;
    ring_.write(record_);
  }

  // Motors at rest whichever way the loop ends.
  void halt() {
    std::fill_n(command_.data() + spools_, device_.sizes.tendons, 0.0);
    if (!device_.simulated()) device_.write(command_.data());
    device_.stop();
  }

  Device& device_;
  AnyController& controller_;
  Settings settings_;
  RingWriter ring_;
  std::vector<double> record_;

  std::thread thread_;
  std::atomic<bool> ending_, running_, forget_, absent_, operated_, stop_ordered_;
  Queue<Order, 1024> orders_;
  Queue<PlayedTick, played_ahead> played_;
  std::atomic<std::uint64_t> lease_;

  AnyInput input_{};
  std::vector<double> command_, before_;  // rows: of this tick, and of the one before
  std::size_t spools_;                    // first column of the spools' velocities
  std::pair<std::size_t, std::size_t> contacts_;
  std::vector<Follower> hand_;
  Motors motors_;
  bool played_now_{};
  TimedInjection injection_[most_axes][engine::injection_point_count]{};
  RequestQueue requests_;
  // Whether a stop is in force, lets the motors return once they stand, and whether they do.
  bool stopped_{}, returns_{}, halted_{};
  std::array<std::atomic<double>, most_axes> wound_{};
  std::uint64_t tick_{};
  std::uint64_t begun_{}, next_{}, last_fresh_{}, late_now_{}, measured_at_{};

  Durations compute_, control_, lateness_;
  std::atomic<std::uint64_t> ticks_, late_, missed_;
  std::atomic<Problem> problem_;
  std::atomic<double> speed_;
  mutable std::mutex refused_mutex_;
  std::vector<std::string> refused_;
};

}  // namespace tenodesis::runtime
