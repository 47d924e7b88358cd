// The twin of a chain of joints that share tendons, for Python.

#include "engine/chain_twin.hpp"

#include <algorithm>

#include "chain_spec.hpp"

namespace tenodesis::bindings {
namespace {

using namespace engine;

std::unique_ptr<AnyTwin> make_chain_twin(const ChainSpec& spec, const In<3>& passages, const std::vector<int>& contacts,
                                         const In<2>& segments, const In<2>& links, const In<2>& load_cells,
                                         const std::vector<double>& damping,
                                         const std::array<double, wrench_components>& rig,
                                         const std::vector<double>& parameters, int law, int steps_per_sample,
                                         bool quasi_static, bool currents, std::uint64_t seed) {
  const std::size_t tendons = spec.tendons();
  require(passages.shape(0) == tendons && passages.shape(2) == passage_numbers && contacts.size() == tendons &&
              tendons > 0 && segments.shape(0) == tendons && segments.shape(1) == passages.shape(1) + 1 &&
              links.shape(0) == spec.joints() && links.shape(1) == link_numbers && load_cells.shape(0) == tendons &&
              load_cells.shape(1) == load_cell_numbers && damping.size() == tendons &&
              parameters.size() == chain_twin_names.size() && law >= 0 && law <= int(ChainLaw::capstan_power),
          "the twin's rows do not fit the chain");
  const auto most = std::size_t(2 * most_vertices) * spec.joints() + std::size_t(most_long_sheath_contacts);
  for (std::size_t m = 0; m < tendons; ++m) {
    require(contacts[m] >= 1 && std::cmp_less_equal(contacts[m], passages.shape(1)) &&
                std::cmp_less_equal(contacts[m], most),
            "a tendon has too many contacts");
    for (std::size_t j = 0; std::cmp_less(j, contacts[m]); ++j)
      require(
          passages(m, j, passage_joint) >= -1 && passages(m, j, passage_joint) < double(spec.joints() + spec.handles()),
          "a tendon crosses a joint that is not there");
  }
  const TwinRows rows{passages.data(),   passages.shape(1),
                      contacts,          segments.data(),
                      links.data(),      load_cells.data(),
                      damping.data(),    rig.data(),
                      parameters.data(), ChainLaw(law),
                      steps_per_sample,  quasi_static,
                      currents,          seed};
  const ChainSizes sizes{spec.joints(), spec.handles(), tendons};
  return twin_of(spec.any(), rows, sizes);
}

/// Mass matrix and moments of constant rates of every point.
void chain_inertia(const ChainSpec& spec, const In<2>& links, const In<2>& angles, const In<2>& speeds,
                   const Out<3>& matrix, const Out<2>& bias) {
  const std::size_t n = spec.joints();
  const std::size_t count = angles.shape(0);
  require(links.shape(0) == n && links.shape(1) == link_numbers && angles.shape(1) == n && speeds.shape(0) == count &&
              speeds.shape(1) == n && matrix.shape(0) == count && matrix.shape(1) == n && matrix.shape(2) == n &&
              bias.shape(0) == count && bias.shape(1) == n,
          "the arrays do not fit the chain");
  std::visit(
      [&]<class W>(const W& chain) {
        constexpr int N = W::joints;
        Link<double> link[N];
        for (int i = 0; i < N; ++i) {
          link[i] = inert_link<double>;
          if (std::cmp_greater_equal(i, n)) continue;
          const double* at = links.data() + std::size_t(i) * link_numbers;
          link[i] = {at[link_mass], at[link_centre], {at[inertia_x], at[inertia_y], at[inertia_z]}};
        }
        const std::size_t own = std::min(n, std::size_t(N));
        for (std::size_t p = 0; p < count; ++p) {
          double x[N]{}, speed[N]{}, mass[N][N], moment[N];
          for (std::size_t i = 0; i < own; ++i) {
            x[i] = coordinate_at(chain.joint[i].mechanism, angles.data()[p * n + i]);
            speed[i] = speeds.data()[p * n + i];
          }
          inertia(chain, link, x, speed, mass, moment);
          std::copy_n(moment, own, bias.data() + p * n);
          for (std::size_t i = 0; i < own; ++i) std::copy_n(mass[i], own, matrix.data() + (p * n + i) * n);
        }
      },
      spec.any());
}

}  // namespace

void bind_chain_twin(nb::module_& m) {
  m.def("chain_twin", &make_chain_twin, "chain"_a, "passages"_a, "contacts"_a, "segments"_a, "links"_a, "load_cells"_a,
        "damping"_a, "rig"_a, "parameters"_a, "law"_a, "steps_per_sample"_a, "quasi_static"_a, "currents"_a, "seed"_a,
        "The twin of a chain, at rest. passages: by tendon and contact the joint (-1: the sheath; the handle's count "
        "on), friction coefficient, wrap in rad of sheath or guides, share, arm in m, bend that the joint unwinds; "
        "links: by "
        "joint mass, its centre, inertia about x, y, z, damping, its stops and their stiffness, reach of the tip; "
        "load_cells: gain, bias, noise, range and resolution by tendon; damping: by tendon, N s/m; rig: wrench on the "
        "tip by a newton of weight; law: 0 "
        "capstan with a constant part, 1 Stribeck, 2 power.");
  m.def("chain_inertia", &chain_inertia, "chain"_a, "links"_a, "angles"_a, "speeds"_a, "matrix"_a, "bias"_a);
  m.def("chain_twin_parameters", [] { return list_of(chain_twin_names); });
}

}  // namespace tenodesis::bindings
