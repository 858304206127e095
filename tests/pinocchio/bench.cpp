// Times of Pinocchio's algorithms on a robot with a free-flyer base: one line an algorithm, "name nanoseconds".
// Each figure is the median over batches of the mean time of a call, each call at another of 64 states.
// The same protocol as crates/rigid_body/examples/dynamics_times.rs.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include <pinocchio/algorithm/aba.hpp>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/joint-configuration.hpp>
#include <pinocchio/algorithm/rnea-derivatives.hpp>
#include <pinocchio/algorithm/rnea.hpp>
#include <pinocchio/parsers/urdf.hpp>

namespace pin = pinocchio;
constexpr int kStates = 64, kBatches = 4001, kCallsPerBatch = 16;

template <class F> void measure(const char *name, F &&call) {
  std::vector<double> times;
  for (int batch = 0; batch < kBatches; ++batch) {
    const auto start = std::chrono::steady_clock::now();
    for (int i = 0; i < kCallsPerBatch; ++i) call((batch * kCallsPerBatch + i) % kStates);
    const std::chrono::duration<double, std::nano> spent = std::chrono::steady_clock::now() - start;
    times.push_back(spent.count() / kCallsPerBatch);
  }
  std::nth_element(times.begin(), times.begin() + kBatches / 2, times.end());
  std::printf("%s %.1f\n", name, times[kBatches / 2]);
}

int main(int argc, char **argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: bench ROBOT.urdf\n");
    return 2;
  }
  pin::Model model;
  pin::urdf::buildModel(std::string(argv[1]), pin::JointModelFreeFlyer(), model);
  if (model.nv != 18) {
    std::fprintf(stderr, "expected 18 coordinates, the model has %d\n", model.nv);
    return 1;
  }
  pin::Data data(model);
  std::srand(1);
  std::vector<Eigen::VectorXd> q, v, a;
  for (int i = 0; i < kStates; ++i) {
    q.push_back(pin::integrate(model, pin::neutral(model), Eigen::VectorXd(Eigen::VectorXd::Random(18))));
    v.push_back(Eigen::VectorXd::Random(18));
    a.push_back(Eigen::VectorXd::Random(18));
  }
  Eigen::MatrixXd dq = Eigen::MatrixXd::Zero(18, 18), dv = dq, da = dq;
  for (int i = 0; i < 2000; ++i) pin::computeRNEADerivatives(model, data, q[i % kStates], v[i % kStates], a[i % kStates], dq, dv, da);
  measure("rnea", [&](int i) { pin::rnea(model, data, q[i], v[i], a[i]); });
  measure("crba", [&](int i) { pin::crba(model, data, q[i], pin::Convention::WORLD); });
  measure("crba_local", [&](int i) { pin::crba(model, data, q[i], pin::Convention::LOCAL); });
  measure("aba", [&](int i) { pin::aba(model, data, q[i], v[i], a[i], pin::Convention::WORLD); });
  measure("aba_local", [&](int i) { pin::aba(model, data, q[i], v[i], a[i], pin::Convention::LOCAL); });
  measure("rnea_derivatives", [&](int i) { pin::computeRNEADerivatives(model, data, q[i], v[i], a[i], dq, dv, da); });
}
