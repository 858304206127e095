// Times of Pinocchio's algorithms on a robot with a free-flyer base: one line an algorithm, "name nanoseconds".
// Each figure is the median over batches of the mean time of a call, each call at another of 64 states: the same
// protocol as crates/rigid_body/src/bin/dynamics_times.rs. The model comes from dump_model.py and is built here, so
// that all of Pinocchio is compiled with this file's flags (its binary library is built for plain x86-64).
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <vector>

#include <pinocchio/fwd.hpp>

#include <pinocchio/algorithm/aba.hpp>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/joint-configuration.hpp>
#include <pinocchio/algorithm/rnea-derivatives.hpp>
#include <pinocchio/algorithm/rnea.hpp>

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

Eigen::Vector3d vector(std::istream &in) {
  Eigen::Vector3d v;
  in >> v[0] >> v[1] >> v[2];
  return v;
}

Eigen::Matrix3d matrix(std::istream &in) {
  Eigen::Matrix3d m;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) in >> m(r, c);
  return m;
}

pin::Inertia inertia(std::istream &in) {
  double mass = 0;
  in >> mass;
  const Eigen::Vector3d lever = vector(in);
  return pin::Inertia(mass, lever, pin::Symmetric3(matrix(in)));
}

int main(int argc, char **argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: bench MODEL.txt (from dump_model.py)\n");
    return 2;
  }
  std::ifstream in(argv[1]);
  pin::Model model;
  const auto base = model.addJoint(0, pin::JointModelFreeFlyer(), pin::SE3::Identity(), "base");
  model.appendBodyToJoint(base, inertia(in));
  for (std::size_t parent = 0; in >> parent;) {
    const Eigen::Vector3d axis = vector(in);
    const Eigen::Matrix3d rotation = matrix(in);
    const pin::SE3 placement(rotation, vector(in));
    const std::string name = "joint" + std::to_string(model.njoints);
    pin::JointIndex id;  // the joint types that Pinocchio's own URDF reader picks
    if (axis.isApprox(Eigen::Vector3d::UnitX())) id = model.addJoint(parent, pin::JointModelRX(), placement, name);
    else if (axis.isApprox(Eigen::Vector3d::UnitY())) id = model.addJoint(parent, pin::JointModelRY(), placement, name);
    else if (axis.isApprox(Eigen::Vector3d::UnitZ())) id = model.addJoint(parent, pin::JointModelRZ(), placement, name);
    else id = model.addJoint(parent, pin::JointModelRevoluteUnaligned(axis), placement, name);
    model.appendBodyToJoint(id, inertia(in));
  }
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
  for (int i = 0; i < 2000; ++i) {
    const int k = i % kStates;
    pin::computeRNEADerivatives(model, data, q[k], v[k], a[k], dq, dv, da);
  }
  // Where Pinocchio has an algorithm in two frames, the faster one is to be compared with.
  measure("rnea", [&](int i) { pin::rnea(model, data, q[i], v[i], a[i]); });
  measure("crba", [&](int i) { pin::crba(model, data, q[i], pin::Convention::WORLD); });
  measure("crba", [&](int i) { pin::crba(model, data, q[i], pin::Convention::LOCAL); });
  measure("aba", [&](int i) { pin::aba(model, data, q[i], v[i], a[i], pin::Convention::WORLD); });
  measure("aba", [&](int i) { pin::aba(model, data, q[i], v[i], a[i], pin::Convention::LOCAL); });
  measure("rnea_derivatives", [&](int i) { pin::computeRNEADerivatives(model, data, q[i], v[i], a[i], dq, dv, da); });
}
