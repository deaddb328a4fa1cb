// As much of ROS 2 and of Autoware's messages as the generated node names; fed by standard input.
#pragma once
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <iostream>
#include <memory>
#include <string>
#include <vector>

namespace builtin_interfaces::msg
{
struct Time
{
  std::int32_t sec = 0;
  std::uint32_t nanosec = 0;
};
}

namespace std_msgs::msg
{
struct Header {builtin_interfaces::msg::Time stamp;};
}

namespace rcl_interfaces::msg
{
struct SetParametersResult {bool successful = false; std::string reason;};
}

namespace geometry_msgs::msg
{
struct Vector3 {double x = 0.0, y = 0.0, z = 0.0;};
using Point = Vector3;
struct Quaternion {double x = 0.0, y = 0.0, z = 0.0, w = 1.0;};
struct Pose {Point position; Quaternion orientation;};
struct Twist {Vector3 linear, angular;};
struct PoseWithCovariance {Pose pose;};
struct TwistWithCovariance {Twist twist;};
}

namespace nav_msgs::msg
{
struct Odometry
{
  std_msgs::msg::Header header;
  geometry_msgs::msg::PoseWithCovariance pose;
  geometry_msgs::msg::TwistWithCovariance twist;
};
}

namespace autoware_planning_msgs::msg
{
struct TrajectoryPoint {geometry_msgs::msg::Pose pose;};
struct Trajectory {std::vector<TrajectoryPoint> points;};
}

namespace autoware_vehicle_msgs::msg
{
struct SteeringReport
{
  builtin_interfaces::msg::Time stamp;
  float steering_tire_angle = 0.0F;
};
}

namespace autoware_control_msgs::msg
{
struct Lateral
{
  builtin_interfaces::msg::Time stamp, control_time;
  float steering_tire_angle = 0.0F, steering_tire_rotation_rate = 0.0F;
  bool is_defined_steering_tire_rotation_rate = false;
};
}

namespace rclcpp
{
inline double present = 0.0;
inline std::function<void()> tick;

class Parameter
{
public:
  Parameter(const std::string & name, const std::vector<double> & values)
  : name_(name), values_(values) {}
  const std::string & get_name() const {return name_;}
  double as_double() const {return values_.at(0);}
  const std::vector<double> & as_double_array() const {return values_;}

private:
  std::string name_;
  std::vector<double> values_;
};
inline std::function<rcl_interfaces::msg::SetParametersResult(const std::vector<Parameter> &)> change;
template<typename T>
std::function<void(const T &)> receive;

struct Time
{
  double seconds() const {return present;}
  operator builtin_interfaces::msg::Time() const
  {
    const auto whole = static_cast<std::int32_t>(present);
    return {whole, static_cast<std::uint32_t>(1e9 * (present - whole))};
  }
};

template<typename T>
struct Subscription {using SharedPtr = std::shared_ptr<Subscription<T>>;};
struct TimerBase {using SharedPtr = std::shared_ptr<TimerBase>;};
template<typename T>
struct Publisher
{
  using SharedPtr = std::shared_ptr<Publisher<T>>;
  void publish(const T & message)
  {
    const auto & of = message.control_time;
    std::printf("%.9g %.9f\n", double(message.steering_tire_angle), of.sec + 1e-9 * of.nanosec);
  }
};
struct Logger {};

class Node
{
public:
  struct OnSetParametersCallbackHandle
  {
    using SharedPtr = std::shared_ptr<OnSetParametersCallbackHandle>;
  };
  explicit Node(const std::string &) {}
  template<typename F>
  OnSetParametersCallbackHandle::SharedPtr add_on_set_parameters_callback(F && function)
  {
    change = function;
    return std::make_shared<OnSetParametersCallbackHandle>();
  }
  template<typename T>
  T declare_parameter(const std::string &, const T & value) {return value;}
  template<typename T, typename F>
  std::shared_ptr<Subscription<T>> create_subscription(const std::string &, int, F && function)
  {
    receive<T> = function;
    return std::make_shared<Subscription<T>>();
  }
  template<typename T>
  std::shared_ptr<Publisher<T>> create_publisher(const std::string &, int)
  {
    return std::make_shared<Publisher<T>>();
  }
  template<typename D, typename F>
  std::shared_ptr<TimerBase> create_wall_timer(D, F && function)
  {
    tick = function;
    return std::make_shared<TimerBase>();
  }
  Time now() const {return Time{};}
  Logger get_logger() const {return Logger{};}
};

inline void init(int, char **) {}
inline void shutdown() {}

// Standard input: the number of points and the points; then rows of time, whether something arrives,
// x, y, half the yaw's sine and cosine, v_x, v_y, yaw rate, wheel angle, how late the messages' stamps are, and a
// count of parameters that are set before, with these.
inline void spin(const std::shared_ptr<Node> &)
{
  autoware_planning_msgs::msg::Trajectory line;
  std::size_t count = 0;
  std::cin >> count;
  line.points.resize(count);
  for (auto & each : line.points) {
    std::cin >> each.pose.position.x >> each.pose.position.y;
  }
  nav_msgs::msg::Odometry seen;
  autoware_vehicle_msgs::msg::SteeringReport report;
  auto & pose = seen.pose.pose;
  auto & twist = seen.twist.twist;
  bool arrives = false;
  double late = 0.0;
  std::size_t numbers = 0;
  while (std::cin >> present >> arrives >> pose.position.x >> pose.position.y >>
    pose.orientation.z >> pose.orientation.w >> twist.linear.x >> twist.linear.y >>
    twist.angular.z >> report.steering_tire_angle >> late >> numbers)
  {
    std::vector<double> values(numbers);
    for (auto & each : values) {
      std::cin >> each;
    }
    if (numbers > 0) {
      const auto answer = change({Parameter("parameters", values)});
      std::fprintf(stderr, "%s%s\n", answer.successful ? "taken" : "refused: ", answer.reason.c_str());
    }
    present -= late;
    seen.header.stamp = report.stamp = Time{};
    present += late;
    if (arrives) {
      receive<autoware_planning_msgs::msg::Trajectory>(line);
      receive<nav_msgs::msg::Odometry>(seen);
      receive<autoware_vehicle_msgs::msg::SteeringReport>(report);
    }
    tick();
  }
}
}

#define RCLCPP_WARN(logger, text) ((void)(logger), (void)std::fprintf(stderr, "%s\n", text))
