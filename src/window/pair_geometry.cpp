// SPDX-License-Identifier: BSD-3-Clause
#include "window/pair_geometry.h"

namespace dsorb::window {
namespace {

void setFirst(PairGeometry& pair, const Keyframe& host, const Keyframe& target) {
  const SE3 T_target_host = target.T_cam_world_first * host.T_cam_world_first.inverse();
  const BrightnessTransfer transfer = brightnessTransfer(
      host.firstAffine(), host.frame->exposure(), target.firstAffine(), target.frame->exposure());
  pair.R_first = T_target_host.rotationMatrix().cast<float>();
  pair.t_first = T_target_host.translation().cast<float>();
  pair.host_offset_first = static_cast<float>(host.firstAffine().b);
  // Left increments: xi_relative = xi_target - Ad(T_target_host) xi_host; r falls with the gain.
  pair.to_host.setZero();
  pair.to_host.topLeftCorner<6, 6>() = -T_target_host.adjoint().transpose();
  pair.to_host(6, 6) = transfer.gain;
  pair.to_host(7, 7) = transfer.gain;
  pair.to_host = frameScale().asDiagonal() * pair.to_host;
  pair.to_target << 1, 1, 1, 1, 1, 1, -transfer.gain, -1;
  pair.to_target = frameScale().cwiseProduct(pair.to_target);
  pair.to_host_single = pair.to_host.cast<float>();
  pair.to_target_single = pair.to_target.cast<float>();
}

}  // namespace

PairTable::PairTable(const Window& window) : size_(window.keyframes.size()), pairs_(size_ * size_) {
  refreshFirst(window);
  refreshCurrent(window);
}

void PairTable::refreshFirst(const Window& window) {
  for (std::size_t host = 0; host < size_; ++host) {
    for (std::size_t target = 0; target < size_; ++target) {
      if (host == target) continue;
      setFirst(pairs_[host * size_ + target], window.keyframes[host], window.keyframes[target]);
    }
  }
}

void PairTable::refreshCurrent(const Window& window) {
  const Eigen::Matrix3d K = window.camera().matrix();
  const Eigen::Matrix3d K_inverse = K.inverse();
  std::vector<SE3> poses;
  for (const Keyframe& keyframe : window.keyframes) poses.push_back(keyframe.T_cam_world());
  for (std::size_t host = 0; host < size_; ++host) {
    const Keyframe& from = window.keyframes[host];
    const SE3 T_world_host = poses[host].inverse();
    for (std::size_t target = 0; target < size_; ++target) {
      if (host == target) continue;
      const Keyframe& to = window.keyframes[target];
      const SE3 T_target_host = poses[target] * T_world_host;
      const BrightnessTransfer transfer = brightnessTransfer(
          from.affine(), from.frame->exposure(), to.affine(), to.frame->exposure());
      PairGeometry& pair = pairs_[host * size_ + target];
      pair.KRKi = (K * T_target_host.rotationMatrix() * K_inverse).cast<float>();
      pair.Kt = (K * T_target_host.translation()).cast<float>();
      pair.gain = static_cast<float>(transfer.gain);
      pair.offset = static_cast<float>(transfer.offset);
    }
  }
}

}  // namespace dsorb::window
