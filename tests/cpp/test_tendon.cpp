// Claims about one tendon with friction: closed forms, and random motions against a solver that shares no code with it.

#include "tenodesis/tendon.hpp"

#include <algorithm>
#include <array>
#include <random>

#include "claim.hpp"

using namespace tenodesis;

constexpr double total_stiffness = 3e4;  // N/m
constexpr double pretension = 20;        // N
constexpr double time_step = 1e-3;       // s

/// A tendon between a spool and a tip, stepped like the twin steps it.
template <class S, int n>
struct Pulled {
  using Rows = Contacts<n>;
  Tendon<S, Rows> tendon{};
  Row<Band<S>, n> band{};
  TendonState<S, Rows> state{};
  Tendon<S, Rows>::Line line{};
  Row<S, n> from{};
  int sweeps = 0;

  Pulled(const std::array<double, n>& exponents, double constant, double viscous) {
    const CapstanWithConstant<S> law{S(constant)};
    tendon.rest_tension = S(pretension);
    for (int i = 0; i <= n; ++i) {
      tendon.stiffness[i] = S(total_stiffness * (n + 1));
      state.tension[i] = tendon.rest_tension;
    }
    for (int j = 0; j < n; ++j) {
      band[j] = law.band(S(exponents[std::size_t(j)]), S(0));
      band[j].drag = S(viscous / time_step) + least_drag<S> * tendon.stiffness[j];
    }
  }

  S scale() const {
    S most = tendon.rest_tension;
    for (const S each : state.tension.at) most = larger(most, each);
    return most;
  }

  void react(const Reaction<S>& spool, S drawn) {
    from = state.slip;
    Row<S, n + 1> pull{};
    pull[n] = drawn;
    sweeps = settle(tendon, band, pull, spool, friction_tolerance<S> * scale(), state, line);
  }
  void wind(S wound, S drawn = S(0)) { react(tendon.held_by_spool(wound), drawn); }
  void pull(S tension, S drawn = S(0)) { react({tension, S(0)}, drawn); }

  S proximal() const { return state.tension[0]; }
  S distal() const { return state.tension[n]; }

  double dissipated() const {
    double lost = 0;
    for (int j = 0; j < n; ++j)
      lost += double(state.tension[j] - state.tension[j + 1]) * double(state.slip[j] - from[j]);
    return lost;
  }
};

/// The same tendon by brute force: one contact after another is bisected onto its law until nothing moves any more.
template <int n>
struct BruteForce {
  static constexpr std::size_t count = n;
  std::array<double, n + 1> stiffness{};
  std::array<double, n> ratio{}, constant{}, drag{}, slip{};

  explicit BruteForce(const Pulled<double, n>& like) {
    for (int i = 0; i <= n; ++i) stiffness[std::size_t(i)] = like.tendon.stiffness[i];
    for (std::size_t j = 0; j < count; ++j) {
      ratio[j] = like.band[int(j)].ratio;
      constant[j] = like.band[int(j)].constant;
      drag[j] = like.band[int(j)].drag;
    }
  }

  double tension(std::size_t i, double wound, double drawn) const {
    const double toward_spool = i == 0 ? wound : slip[i - 1];
    const double toward_tip = i == count ? drawn : -slip[i];
    return std::max(0.0, pretension + stiffness[i] * (toward_spool + toward_tip));
  }

  // By how much the pulled side exceeds what friction holds once the contact has slid by so much that way.
  double excess(std::size_t j, int way, double from, double slid, double wound, double drawn) {
    slip[j] = from + way * slid;
    const double spool = tension(j, wound, drawn);
    const double tip = tension(j + 1, wound, drawn);
    return (way > 0 ? spool - ratio[j] * tip : tip - ratio[j] * spool) - constant[j] - drag[j] * slid;
  }

  // Returns by how much the contact moved.
  double project(std::size_t j, double from, double wound, double drawn) {
    const double before = slip[j];
    for (const int way : {1, -1}) {
      if (excess(j, way, from, 0, wound, drawn) <= 0) continue;
      double low = 0, high = 1e-6;
      while (excess(j, way, from, high, wound, drawn) > 0) high *= 2;
      for (int round = 0; round < 100 && low < high; ++round) {
        const double middle = low + (high - low) / 2;
        if (middle == low || middle == high) break;
        (excess(j, way, from, middle, wound, drawn) > 0 ? low : high) = middle;
      }
      slip[j] = from + way * high;
      return std::fabs(slip[j] - before);
    }
    slip[j] = from;
    return std::fabs(from - before);
  }

  /// Returns whether it has come to rest.
  bool wind(double wound, double drawn) {
    const std::array<double, n> from = slip;
    double moved = 1;
    for (int round = 0; round < 100'000 && moved > 1e-17; ++round) {
      moved = 0;
      for (std::size_t j = 0; j < count; ++j) moved = std::max(moved, project(j, from[j], wound, drawn));
    }
    return broken_by(slip, from, wound, drawn) <= 1e-9;
  }

  /// By how much other slips break the law at their worst contact, N.
  double broken_by(const std::array<double, n>& other, const std::array<double, n>& from, double wound, double drawn) {
    slip = other;
    double broken = 0;
    for (std::size_t j = 0; j < count; ++j) {
      slip = other;
      const double slid = slip[j] - from[j];
      const int way = slid < 0 ? -1 : 1;
      const double off = excess(j, way, from[j], std::fabs(slid), wound, drawn);
      broken = std::max(broken, slid == 0 ? off : std::fabs(off));
      if (slid == 0) broken = std::max(broken, excess(j, -1, from[j], 0, wound, drawn));
    }
    slip = other;
    return broken;
  }
};

void a_constant_part_adds_to_the_pulled_side_whatever_the_load() {
  for (const double exponent : {0.0, 0.4}) {
    const double ratio = std::exp(exponent);
    Pulled<double, 1> pulled_tendon({exponent}, 1.5, 0);
    double before = pretension;
    for (const double tension : {40.0, 80.0, 120.0}) {
      pulled_tendon.pull(tension);
      CLAIM_NEAR(tension - ratio * pulled_tendon.distal(), 1.5, 1e-6);
      CLAIM(pulled_tendon.distal() > before);
      before = pulled_tendon.distal();
    }
    for (const double tension : {30.0, 10.0, 0.0}) {
      pulled_tendon.pull(tension);
      CLAIM_NEAR(pulled_tendon.distal() - ratio * tension, 1.5, 1e-6);
    }
  }
}

void a_viscous_part_adds_in_proportion_to_speed() {
  for (const double exponent : {0.0, 0.4}) {
    Pulled<double, 1> pulled_tendon({exponent}, 0, 200);
    const double ratio = std::exp(exponent);
    double wound = 0;
    for (const double speed : {0.02, 0.05, -0.05, -0.02}) {
      for (int i = 0; i < 60; ++i) pulled_tendon.wind(wound += speed * time_step);
      const double slipped = pulled_tendon.state.slip[0] - pulled_tendon.from[0];
      CLAIM(slipped * speed > 0);
      const double pulled = speed > 0 ? pulled_tendon.proximal() : pulled_tendon.distal();
      const double held = speed > 0 ? pulled_tendon.distal() : pulled_tendon.proximal();
      CLAIM_NEAR(pulled - ratio * held, 200 * std::fabs(slipped) / time_step, 1e-6);
    }
    // At rest what is left of it fades.
    for (int i = 0; i < 2000; ++i) pulled_tendon.wind(wound);
    CLAIM(std::fabs(pulled_tendon.proximal() - pulled_tendon.distal()) <=
          (ratio - 1) * larger(pulled_tendon.proximal(), pulled_tendon.distal()) + 1e-9);
  }
}

void a_constant_part_leaves_the_far_end_taut_where_the_spool_lets_go() {
  Pulled<double, 1> pulled_tendon({0.3}, 2, 0);
  pulled_tendon.wind(-5e-3);
  CLAIM(pulled_tendon.proximal() == 0);
  CLAIM_NEAR(pulled_tendon.distal(), 2, 1e-6);
}

void one_contact_transmits_what_a_tendon_pulled_by_tension_does() {
  std::mt19937 random(3);  // NOLINT(cert-msc32-c,cert-msc51-cpp,bugprone-random-generator-seed): the same on every run
  std::uniform_real_distribution<double> pick(0, 100);
  Pulled<double, 1> pulled_tendon({0.4}, 0.5, 0);
  Band<double> band = pulled_tendon.band[0];
  double held = pretension;
  for (int i = 0; i < 2000; ++i) {
    const double tension = i % 50 == 7 ? 0 : pick(random);
    pulled_tendon.pull(tension);
    held = transmit(band, tension, held);
    CLAIM_NEAR(pulled_tendon.distal(), held, 1e-6);
  }
}

/// How one random motion goes: by steps of its own size, of either end.
struct Motion {
  double step;  // m
  double constant;
  double viscous;
};

template <int n>
void random_motions_agree_with_brute_force(const Motion& motion, int steps, unsigned seed) {
  std::mt19937 random(seed);  // NOLINT(cert-msc51-cpp): seeds of its own, the same on every run
  const auto between = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  std::array<double, n> exponents{};
  for (double& each : exponents) each = random() % 5 == 0 ? 0 : between(0, 0.6);
  Pulled<double, n> ours(exponents, motion.constant, motion.viscous);
  BruteForce<n> theirs(ours);
  double wound = 0, drawn = 0, way = 1;
  int slack = 0, most = 0, unsettled = 0;
  for (int step = 0; step < steps; ++step) {
    if (random() % 20 == 0) way = -way;
    wound = std::clamp(wound + motion.step * (way + between(-1, 1)), -1.5e-3, 2e-3);
    drawn = std::clamp(drawn + motion.step * between(-0.5, 0.5), -3e-4, 3e-4);
    ours.wind(wound, drawn);
    const bool settled = theirs.wind(wound, drawn);
    unsettled += !settled;
    const double scale = ours.scale();
    most = std::max(most, ours.sweeps);
    CLAIM(ours.sweeps <= most_sweeps(n));
    CLAIM(ours.tendon.residual(ours.band, ours.from, ours.state) <= 1e-9 * scale);
    CLAIM(ours.dissipated() >= -1e-15 * scale);
    std::array<double, n> found{}, before{};
    std::copy_n(ours.state.slip.at, n, found.begin());
    std::copy_n(ours.from.at, n, before.begin());
    CLAIM(BruteForce<n>(theirs).broken_by(found, before, wound, drawn) <= 1e-9 * scale);
    // What floats between slack ends is held by the least drag alone, which brute force takes for ever over.
    if (!settled) theirs.slip = found;
    for (int i = 0; i <= n; ++i) CLAIM_NEAR(ours.state.tension[i], theirs.tension(std::size_t(i), wound, drawn), 1e-6);
    slack += ours.proximal() == 0;
  }
  CLAIM(unsettled * 100 <= steps);
  std::printf("%d contacts, step %g mm, constant %g N, viscous %g N s/m: at most %d sweeps, %d of %d steps slack\n", n,
              motion.step * 1e3, motion.constant, motion.viscous, most, slack, steps);
}

template <int n>
void random_motions_of_any_kind_agree_with_brute_force(int steps) {
  unsigned seed = 100 * n;
  for (const double step : {1e-6, 3e-5, 1e-3})
    for (const double constant : {0.0, 0.3})
      for (const double viscous : {0.0, 20.0})
        random_motions_agree_with_brute_force<n>({step, constant, viscous}, steps, ++seed);
}

template <int n>
void small_steps_take_few_sweeps_and_float_follows_double() {
  std::mt19937 random(5);  // NOLINT(cert-msc32-c,cert-msc51-cpp,bugprone-random-generator-seed): the same on every run
  std::array<double, n> exponents{};
  for (double& each : exponents) each = std::uniform_real_distribution<double>(0, 0.4)(random);
  Pulled<double, n> wide(exponents, 0.1, 0);
  Pulled<float, n> narrow(exponents, 0.1, 0);
  double wound = 0, way = 1;
  int most = 0, most_narrow = 0;
  double lost = 0, worst = 0;
  for (int step = 0; step < 20'000; ++step) {
    if (random() % 300 == 0) way = -way;
    // Lengths that both number types hold exactly, 2^-20 m.
    wound = std::clamp(wound + way * 0x1p-20, -0x1p-10, 0x1p-9);
    wide.wind(wound);
    narrow.wind(float(wound));
    most = std::max(most, wide.sweeps);
    most_narrow = std::max(most_narrow, narrow.sweeps);
    lost += wide.dissipated();
    CLAIM(wide.dissipated() >= -1e-15 * wide.scale());
    for (int i = 0; i <= n; ++i)
      worst = std::max(worst, std::fabs(double(narrow.state.tension[i]) - wide.state.tension[i]));
  }
  CLAIM(most <= most_sweeps(n));
  CLAIM(most_narrow <= most_sweeps(n));
  CLAIM(lost > 0);
  // A float holds a length of 2 mm to 1.2e-10 m, which is 1.2e-10 k (n + 1) of tension.
  CLAIM_NEAR(worst, 0, 4 * (n + 1) * 1.2e-10 * total_stiffness * (n + 1));
  std::printf("%d contacts: at most %d sweeps in double, %d in float, which is off by %.2g N at most\n", n, most,
              most_narrow, worst);
}

int main() {
  a_constant_part_adds_to_the_pulled_side_whatever_the_load();
  a_viscous_part_adds_in_proportion_to_speed();
  a_constant_part_leaves_the_far_end_taut_where_the_spool_lets_go();
  one_contact_transmits_what_a_tendon_pulled_by_tension_does();
  random_motions_of_any_kind_agree_with_brute_force<1>(300);
  random_motions_of_any_kind_agree_with_brute_force<3>(300);
  random_motions_of_any_kind_agree_with_brute_force<4>(300);
  random_motions_of_any_kind_agree_with_brute_force<8>(150);
  small_steps_take_few_sweeps_and_float_follows_double<1>();
  small_steps_take_few_sweeps_and_float_follows_double<4>();
  small_steps_take_few_sweeps_and_float_follows_double<8>();
  return claims::report();
}
